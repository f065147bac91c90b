"""Terms whose force depends on what came before."""

from abc import abstractmethod

from crane_model.array import Array
from crane_model.record import Record
from crane_model.terms.joint_term import OneJointTerm
from crane_model.terms.term import Parameter, Setting, Term


class MemoryTerm(Term):
    """A term with s states that follow the motion.

    Over a recording the states are traced from the start of each run; in forward simulation they
    are advanced beside the motion, and the record brings them along.
    """

    @abstractmethod
    def start(self, record: Record, setting: Setting) -> Array:
        """States (n, s) of n runs that begin at the samples of the record, s >= 1."""

    @abstractmethod
    def advance(self, states: Array, before: Record, after: Record, setting: Setting) -> Array:
        """States (n, s) of n runs one step on; the records hold the two ends of the step."""

    def trace(self, record: Record, setting: Setting) -> Array:
        """States (n, s) at each sample of a recording: `advance` from sample to sample."""
        states = self.start(record, setting)
        first = record.first_of_run
        for k in range(1, len(record)):
            if not first[k]:
                step = record.take(slice(k - 1, k)), record.take(slice(k, k + 1))
                states[k] = self.advance(states[k - 1 : k], *step, setting)[0]
        return states

    def states(self, record: Record, setting: Setting) -> Array:
        """States (n, s) that the record brings along, or else traced over it."""
        known = (record.memory or {}).get(self)
        return self.trace(record, setting) if known is None else known


class JointMemoryTerm(MemoryTerm, OneJointTerm):
    """A term with memory and one parameter, on a single joint."""

    @abstractmethod
    def column(self, states: Array, record: Record, j: int) -> Array:
        """The single regressor column on joint j, given the states (n, s): (n,)."""

    @abstractmethod
    def parameter(self, coordinate: str, force: str) -> Parameter:
        """The single parameter, given the units of the joint's coordinate and force."""

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """The single parameter."""
        return (self.parameter(setting.units[self.joint], setting.force_unit(self.joint)),)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """The single column."""
        return self.column(self.states(record, setting), record, j)
