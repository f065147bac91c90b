"""Serial chains of rigid bodies in space, compiled: kinematics and dynamics of any machine.

Names are imported from their modules when they are first asked for: `Machine` needs the constants
of its chain, and nothing to be compiled.
"""

from crane_model.lazily import lazily

__getattr__, __dir__, __all__ = lazily(
    __name__,
    {
        "serial_chain": ["SerialChain"],
        "pose": ["body_frames", "tip_jacobians", "tip_positions"],
        "ten_parameters": [
            "PER_BODY",
            "TEN_FROM_PSEUDO_INERTIA",
            "fill_regressor",
            "pseudo_inertia",
            "regressor",
        ],
        "slopes": ["pull_back"],
        "dynamics": [
            "coriolis_forces",
            "forward_dynamics",
            "gravity_forces",
            "inverse_dynamics",
            "mass_matrices",
        ],
    },
)
