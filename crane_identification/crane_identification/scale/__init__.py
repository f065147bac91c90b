"""Fits of more recordings than memory, or one machine, holds."""
