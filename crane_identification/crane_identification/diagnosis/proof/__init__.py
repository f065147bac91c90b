"""The findings before recordings that took no part: the gap that they close."""
