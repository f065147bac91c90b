"""The supply that all valves share: its pressure falls with the flow that they draw.

    p_S = p_0 - R sum of what flows from the supply into chambers

A pressure-controlled pump follows within milliseconds, far above what the filter of the balance
leaves, so that the volume of the line does not show.
"""

from collections.abc import Sequence

import numpy as np

from crane_identification.data.log import Log
from crane_identification.hydraulics.balance import ChamberRows
from crane_identification.hydraulics.joint_estimate import JointFit
from crane_identification.hydraulics.projection import BLOCK, BalanceFit, block_covariance
from crane_model.errors import DataError
from crane_model.hydraulics.values import Measured, SupplyValues

LARGEST_SLEW = 0.01  # rad: beyond, the slew has drawn oil that nobody measured


def identify_supply(found: Sequence[JointFit], logs: Sequence[Log]) -> SupplyValues:
    """Pressure and droop; `DataError` where a joint that draws oil is not among those `found`."""
    still = {log.source for log in logs if _still(log)}
    if not still:
        raise DataError(
            "supply: a joint without transducers moves in each recording and draws oil that "
            "nobody measured; record one in which it rests"
        )
    columns, pressures, blocks = [], [], []
    begun = 0
    for passage in _shared(found):
        rows = passage[0][1]
        if rows.passage.source not in still:
            continue
        one, pressure = rows.supply().T
        drawn = sum(part.drawn(fit.spool, fit.linear) for fit, part in passage)
        time = rows.thinned(rows.time)
        columns.append(rows.thinned(np.stack([one, -drawn], axis=1)))
        pressures.append(rows.thinned(pressure))
        blocks.append(begun + ((time - time[0]) / BLOCK).astype(int))
        begun = int(blocks[-1][-1]) + 1
    if not columns:
        raise DataError("supply: no part of a recording in which the flow of all joints is known")
    matrix, pressure, block = (np.concatenate(part) for part in (columns, pressures, blocks))
    norms = np.linalg.norm(matrix, axis=0)
    scaled = matrix / norms
    bread = np.linalg.pinv(scaled.T @ scaled)
    values = bread @ scaled.T @ pressure
    covariance = block_covariance(scaled, pressure - scaled @ values, bread, block)
    std_devs = np.sqrt(np.diag(covariance)) / norms
    level, droop = values / norms
    return SupplyValues(
        pressure=Measured(value=float(level), std_dev=float(std_devs[0]), unit="Pa"),
        droop=Measured(value=max(float(droop), 0.0), std_dev=float(std_devs[1]), unit="Pa s/m3"),
    )


def _still(log: Log) -> bool:
    slew = log.slew_position
    return slew is None or float(np.nanmax(slew.value) - np.nanmin(slew.value)) < LARGEST_SLEW


def _shared(
    found: Sequence[JointFit],
) -> list[list[tuple[BalanceFit, ChamberRows]]]:
    """Rows of all joints that begin and end together."""
    together: dict[tuple[str, float, int], list[tuple[BalanceFit, ChamberRows]]] = {}
    for joint in found:
        for rows in joint.balance.rows:
            part = rows.passage
            key = (part.source, round(float(part.time[0]), 3), len(part))
            together.setdefault(key, []).append((joint.projection, rows))
    return [parts for parts in together.values() if len(parts) == len(found)]
