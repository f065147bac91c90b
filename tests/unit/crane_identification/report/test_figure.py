import json

import numpy as np
import plotly.graph_objects as go

from crane_identification.report.html import MEASURED, SCATTER, Band, Curve, Figure, Panel

TIME = np.linspace(0.0, 10.0, 5000)


def figure() -> Figure:
    curve = np.sin(TIME)
    curve[1000:2000] = np.nan
    upper = Panel("q", "rad", [Curve("measured", MEASURED, TIME, curve)])
    band = Band("scatter", SCATTER, TIME, -np.ones(5000), np.ones(5000))
    lower = Panel("τ", "N m", [Curve("measured", MEASURED, TIME, 1e4 * curve)], [band], height=80)
    return Figure("key", "joint", [upper, lower], left_out=[(1.0, 2.0), (3.0, 4.5)])


def with_colours(value):
    """As page.js does: names of CSS variables become what they stand for."""
    if isinstance(value, str):
        return ("Arial" if value == "--sans" else "#123456") if value[:2] == "--" else value
    if isinstance(value, list):
        return [with_colours(item) for item in value]
    if isinstance(value, dict):
        return {key: with_colours(item) for key, item in value.items()}
    return value


def test_plotly_knows_every_property_of_the_description():
    description = with_colours(figure().description())
    assert len(go.Figure(description).data) == 4


def test_panels_lie_above_each_other_inside_the_figure():
    description = figure()
    layout = description.description()["layout"]
    upper, lower = layout["yaxis"]["domain"], layout["yaxis2"]["domain"]
    assert 0.0 < lower[0] < lower[1] < upper[0] < upper[1] < 1.0
    heights = [(high - low) * description.height for low, high in (upper, lower)]
    np.testing.assert_allclose(heights, [130, 80])
    assert layout["xaxis"]["anchor"] == "y2"


def test_every_axis_says_its_quantity_and_unit():
    layout = figure().description()["layout"]
    assert [a["text"] for a in layout["annotations"]] == ["q [rad]", "τ [N m]"]
    assert layout["xaxis"]["title"]["text"] == "t [s]"


def test_curves_are_short_and_true_to_five_digits():
    trace = figure().description()["data"][0]
    x, y = np.array(trace["x"]), np.array(trace["y"], dtype=float)
    assert len(x) <= 1510
    finite = np.isfinite(y)
    np.testing.assert_allclose(y[finite], np.sin(x[finite]), atol=6e-5 + 6e-4)
    gap = (x > TIME[1001]) & (x < TIME[1998])
    assert not gap.any()
    assert None in trace["y"]
    json.dumps(trace, allow_nan=False)


def test_stretches_left_out_are_shaded_in_every_panel():
    shapes = figure().description()["layout"]["shapes"]
    assert [shape["path"].count("M") for shape in shapes] == [2, 2]
    assert all(shape["layer"] == "below" for shape in shapes)
