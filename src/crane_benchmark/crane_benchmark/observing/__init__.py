"""How well the observers do: machines at work, what they are to reach, and what they reach."""
