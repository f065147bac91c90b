"""Checks of a recording before a fit."""
