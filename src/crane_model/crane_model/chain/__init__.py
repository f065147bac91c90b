"""Serial chains of rigid bodies in space, compiled: kinematics and dynamics of any machine."""

from crane_model.chain.serial_chain import SerialChain

__all__ = ["SerialChain"]
