"""How far an identified model is trusted when something is weighed with it."""

import math
from typing import NamedTuple

from crane_model.model_file import Model
from crane_observer.position.state import Trust
from crane_observer.scale.kinds import CARRIED, CRAWL, DRY, PLACE, SLOW, STICK, VISCOUS, ZERO

SHARPER = 4.0 / 3.0  # power of the position sensor's share: no flow is used here


class ModelDoubt(NamedTuple):
    """Standard deviations, and for how long errors stay; of a model that deserves little trust."""

    zero: float = 0.3e5  # Pa, of the piston's force, for as long as anybody weighs
    slow: float = 0.15e5  # Pa, the same, for a while
    slow_stays: float = 8.0  # s
    dry: float = 0.05  # of dry friction
    viscous: float = 0.05  # of viscous friction
    friction_stays: float = 300.0  # s
    carried: float = 0.03  # of the force that a joint carries, by which friction grows
    crawl: float = 0.25  # of dry friction, by which breakaway exceeds it: (13) has none
    crawl_stays: float = 8.0  # s
    held: float = 1.0  # of dry friction where a joint stands: anywhere
    creep: float = 1.0  # of it, by which it may be elsewhere in each window
    slip_stays: float = 1.0  # s, of friction where a joint sticks and slips
    place_stays: float = 60.0  # s, of errors of an estimated position
    noise: float = 0.2e5  # Pa, of a window, of the piston's force
    sensors: float = 2.3e3  # Pa, the same, by noise of the readings
    inertia: float = 0.1  # of the force that accelerates: encoders tell acceleration badly
    tool: float = 0.5  # kg, of what the model has at the tip
    drift: float = 0.05  # kg/sqrt(s), of a load that nobody changes

    @classmethod
    def of(cls, model: Model) -> "ModelDoubt":
        """As far as the model deserves it, as the position sensor judges it."""
        share = (Trust.of(model).dry / Trust().dry) ** SHARPER
        blamed = ("zero", "slow", "dry", "viscous", "carried", "crawl", "noise", "tool", "drift")
        full = cls()
        return full._replace(**{name: share * getattr(full, name) for name in blamed})

    @property
    def kinds(self) -> dict[int, tuple[float, float]]:
        """Of each kind of state of a joint: standard deviation, and how long it stays [s]."""
        return {
            ZERO: (self.zero, math.inf),
            SLOW: (self.slow, self.slow_stays),
            DRY: (self.dry, self.friction_stays),
            VISCOUS: (self.viscous, self.friction_stays),
            STICK: (self.held, math.inf),
            CARRIED: (self.carried, math.inf),
            PLACE: (1.0, self.place_stays),
            CRAWL: (self.crawl, self.crawl_stays),
        }
