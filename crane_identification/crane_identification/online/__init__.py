"""Identification beside the running crane."""
