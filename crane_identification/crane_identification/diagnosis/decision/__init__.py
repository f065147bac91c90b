"""Which of the effects that were found are findings."""
