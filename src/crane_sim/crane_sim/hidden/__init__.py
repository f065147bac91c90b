"""Effects that the stand-in machine can hide: what the model that is identified does not know of.

They are laws of this package's own, siblings of those that a diagnosis looks for: another formula
or another numerical treatment of the same physics; and some that no catalogue has.
"""
