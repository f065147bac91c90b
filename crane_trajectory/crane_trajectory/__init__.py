"""Excitation trajectories: their design, their check, and the motion of the crane.

The trajectory that ships, one period of it, and the motion of an experiment along it:

>>> import numpy as np
>>> from crane_model.machine import load_machine
>>> from crane_model.machine_files import machine_file
>>> from crane_trajectory import load_clearance, load_trajectory, plan
>>> trajectory = load_trajectory(machine_file("excitation_20s.yaml"))
>>> trajectory.period, trajectory.evaluate(np.arange(0.0, 20.0)).position.shape
(20.0, (20, 3))
>>> machine, clearance = load_machine(), load_clearance(machine_file("clearance.yaml"))
>>> course = plan(machine, trajectory, [0.0, 1.0, -1.5, 0.5], 2, clearance)
>>> course.violations(clearance), bool(course.duration > 40.0)
([], True)

A trajectory of one joint by hand, as (32) has it:

>>> from crane_trajectory import FourierTrajectory
>>> slow = {"offset": 0.8, "sine": [0.3], "cosine": [0.0]}
>>> mine = FourierTrajectory(name="mine", period=10.0, joints={"telescope": slow})
>>> mine.evaluate(np.array([2.5])).position.round(3).tolist()
[[1.1]]
"""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_trajectory.excitation.limits import DesignSettings as DesignSettings
    from crane_trajectory.excitation.limits import load_design_settings as load_design_settings
    from crane_trajectory.experiment import Experiment as Experiment
    from crane_trajectory.experiment import Outcome as Outcome
    from crane_trajectory.motion.check import Clearance as Clearance
    from crane_trajectory.motion.check import load_clearance as load_clearance
    from crane_trajectory.motion.motion import Motion as Motion
    from crane_trajectory.motion.motion import plan as plan
    from crane_trajectory.motion.periodic import FourierTrajectory as FourierTrajectory
    from crane_trajectory.motion.periodic import SweepTrajectory as SweepTrajectory
    from crane_trajectory.motion.periodic import load_trajectory as load_trajectory

__getattr__, __dir__, __all__ = lazily(__name__, __file__)
