"""Terms with one parameter that act on one joint."""

from abc import abstractmethod

import numpy as np

from crane_model.errors import ConfigurationError
from crane_model.record import Record
from crane_model.terms.term import Parameter, Setting, Term


class OneJointTerm(Term):
    """A term with a single parameter, on a single joint."""

    joint: str

    @abstractmethod
    def parameter(self, coordinate: str, force: str) -> Parameter:
        """The single parameter, given the units of the joint's coordinate and force."""

    def parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """One parameter, named symbol.joint."""
        if self.joint not in setting.units:
            raise ConfigurationError(
                f"term '{self.type}': the model has no joint '{self.joint}'; "
                f"its joints are {', '.join(setting.units)}"
            )
        unit = setting.units[self.joint]
        parameter = self.parameter(unit, setting.force_unit(self.joint))
        return (parameter._replace(name=f"{parameter.name}.{self.joint}"),)


class JointTerm(OneJointTerm):
    """A term that depends on the motion of its joint at the same instant alone."""

    @abstractmethod
    def column(self, record: Record, j: int) -> np.ndarray:
        """The single regressor column on joint j: (n,)."""

    def fill(self, record: Record, setting: Setting, columns: np.ndarray) -> None:
        """Zero but on the term's own joint."""
        j = record.column(self.joint)
        columns[:, j, 0] = self.column(record, j)


class MemoryTerm(OneJointTerm):
    """A term whose force depends on what came before, through s states that follow the motion.

    Over a recording the states are traced from the start of each run; in forward simulation they
    are advanced beside the motion, and the record brings them along.
    """

    @abstractmethod
    def start(self, record: Record, setting: Setting) -> np.ndarray:
        """States (n, s) of n runs that begin at the samples of the record."""

    @abstractmethod
    def advance(
        self, states: np.ndarray, before: Record, after: Record, setting: Setting
    ) -> np.ndarray:
        """States (n, s) of n runs one step on; the records hold the two ends of the step."""

    @abstractmethod
    def column(self, states: np.ndarray, record: Record, j: int) -> np.ndarray:
        """The single regressor column on joint j, given the states (n, s): (n,)."""

    def trace(self, record: Record, setting: Setting) -> np.ndarray:
        """States (n, s) at each sample of a recording: `advance` from sample to sample."""
        states = self.start(record, setting)
        first = record.first_of_run
        for k in range(1, len(record)):
            if not first[k]:
                step = record.take(slice(k - 1, k)), record.take(slice(k, k + 1))
                states[k] = self.advance(states[k - 1 : k], *step, setting)[0]
        return states

    def fill(self, record: Record, setting: Setting, columns: np.ndarray) -> None:
        """Zero but on the term's own joint."""
        states = (record.memory or {}).get(self)
        if states is None:
            states = self.trace(record, setting)
        j = record.column(self.joint)
        columns[:, j, 0] = self.column(states, record, j)
