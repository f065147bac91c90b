"""A second plant, of other make than `crane_sim`'s: what a diagnosis meets away from home.

It shares parameters and geometry with the stand-in machine, and no code of its dynamics, friction,
valves or oil.
"""
