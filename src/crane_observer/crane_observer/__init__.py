"""The crane that observes itself: positions without encoders, faulty sensors, the load at the tip.

What the sensor monitor finds, in words:

>>> from crane_observer import Part, SensorFinding, Wrong
>>> size, low, high = 1.0e-3, 0.9e-3, 1.1e-3  # m/s
>>> onset, now = 60.0, 60.7  # s
>>> found = SensorFinding(
...     Part.ENCODER, "telescope", Wrong.DRIFT, "m/s", size, low, high, onset, now
... )
>>> found.sensor
'telescope encoder'

Before a tolerance was learnt from recordings of the machine, a wide one is assumed:

>>> from crane_observer import unlearnt
>>> sorted(unlearnt(["boom", "telescope"]).joints)
['boom', 'telescope']
"""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_observer.monitor.finding import Part as Part
    from crane_observer.monitor.finding import SensorFinding as SensorFinding
    from crane_observer.monitor.finding import Wrong as Wrong
    from crane_observer.monitor.replay import SensorWatch as SensorWatch
    from crane_observer.monitor.tolerance import learn as learn
    from crane_observer.monitor.tolerance import unlearnt as unlearnt
    from crane_observer.position.estimator import PositionEstimator as PositionEstimator
    from crane_observer.position.state import PoseEstimate as PoseEstimate
    from crane_observer.recording import HeardRecording as HeardRecording

__getattr__, __dir__, __all__ = lazily(__name__, __file__)
