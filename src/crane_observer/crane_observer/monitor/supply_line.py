"""Oil that was pressed back into the supply line, and stands there until it is drawn.

A load that comes or goes lifts the pressure of a chamber beyond that of the supply. Where the valve
is open to it, oil flows back; the check valve of the pump keeps it in the line, which stands above
p_0 by as much as it took. From then on the pump delivers nothing, and the line follows no droop,
until as much was drawn again. How much came back is not told by flows: a chamber may be beyond what
its transducer can show, and what passes an edge that hardly opens is not known. So whenever the
line is above p_0 while nothing is drawn, it may be as full as its relief valve lets it; a
transducer that shows too much is told from that by what it shows once so much was drawn.
"""

FEEDING = 1e4  # Pa that the supply droops
MOST = 1e4  # Pa s that a line holds: what is drawn in a second by which it droops by FEEDING


class SupplyLine:
    """Volumes are told by the droop that they would make in a second, Pa s: so a pump that delivers
    more, which droops less, has the larger line. What is in it at first is not known.
    """

    def __init__(self) -> None:
        self._surplus = MOST

    def add(self, droop: float, above: float, span: float) -> bool:
        """Whether there may be a surplus in a block of `span` [s] in which joints let the supply
        droop by `droop` [Pa], 0 where that is not known, and it was `above` p_0 [Pa] in the mean.
        """
        before = self._surplus
        if above + droop <= 0.0:  # the pump holds it
            self._surplus = 0.0
        elif droop > FEEDING:
            self._surplus = max(before - droop * span, 0.0)
        else:
            self._surplus = MOST
        return before > 0.0
