"""An independent simulator, of other make than `crane_sim`.

It shares parameters and geometry with the simulated crane, and no code of its dynamics, friction,
valves or oil.
"""
