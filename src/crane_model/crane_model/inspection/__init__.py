"""`ros2 run crane_model machine`: a look at a machine file before it matters."""
