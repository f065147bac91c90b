"""Inertia and bias of the crane's bodies, as MuJoCo derives them."""

import mujoco
import numpy as np

from crane_model.machine import Machine
from crane_sim.parts.mujoco_model import machine_spec
from crane_sim.parts.parameters import StandIn


class MujocoBodies:
    """M and h of M q'' + h = tau in the coordinates of the machine's j joints."""

    def __init__(self, parameters: StandIn, machine: Machine):
        self._model = machine_spec(parameters, machine).compile()
        self._data = mujoco.MjData(self._model)
        self._led = np.zeros((self._model.nv, len(machine.joint_names)))
        for row, joint in enumerate(machine.joints):
            leader, ratio = machine.led_by(joint)
            self._led[row, leader] = ratio
        # where no joint follows another, their coordinates are those of MuJoCo
        self._alike = np.array_equal(self._led, np.eye(self._model.nv))
        self._full = np.zeros((self._model.nv, self._model.nv))
        self._bias = np.zeros(self._model.nv)

    def at(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(j, j) inertia [kg m2, kg m, kg] and (j,) Coriolis forces and weight [N m, N]."""
        model, data = self._model, self._data
        data.qpos[:], data.qvel[:] = (q, v) if self._alike else (self._led @ q, self._led @ v)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeM(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 0, self._bias)
        mujoco.mj_fullM(model, data, self._full)
        if self._alike:
            return self._full.copy(), self._bias.copy()
        return self._led.T @ self._full @ self._led, self._led.T @ self._bias
