"""Excitation trajectories: their design, their check, and the crane led along them."""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_trajectory.excitation.settings import DesignSettings as DesignSettings
    from crane_trajectory.excitation.settings import load_design_settings as load_design_settings
    from crane_trajectory.experiment import Experiment as Experiment
    from crane_trajectory.experiment import Outcome as Outcome
    from crane_trajectory.motion.check import Clearance as Clearance
    from crane_trajectory.motion.check import load_clearance as load_clearance
    from crane_trajectory.motion.fourier import FourierTrajectory as FourierTrajectory
    from crane_trajectory.motion.motion import Motion as Motion
    from crane_trajectory.motion.motion import plan as plan
    from crane_trajectory.motion.periodic import load_trajectory as load_trajectory
    from crane_trajectory.motion.sweep import SweepTrajectory as SweepTrajectory

__getattr__, __dir__, __all__ = lazily(
    __name__,
    {
        "excitation.settings": ("DesignSettings", "load_design_settings"),
        "experiment": ("Experiment", "Outcome"),
        "motion.check": ("Clearance", "load_clearance"),
        "motion.fourier": ("FourierTrajectory",),
        "motion.motion": ("Motion", "plan"),
        "motion.periodic": ("load_trajectory",),
        "motion.sweep": ("SweepTrajectory",),
    },
)
