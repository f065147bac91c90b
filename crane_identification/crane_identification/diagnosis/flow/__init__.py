"""The balance of the flow of oil, beside that of forces."""
