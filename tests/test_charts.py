"""Charts: the data that they draw, on the axes that they are given."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import diffshade as ds
from diffshade import gallery, plot
from diffshade.colour.cie import Primaries

WIDE = Primaries((0.708, 0.292), (0.170, 0.797), (0.131, 0.046))
"""ITU-R BT.2020."""


@pytest.fixture
def ax() -> Axes:
    return Figure().subplots()


def labels(ax: Axes) -> list[str]:
    return [text.get_text() for text in ax.get_legend().get_texts()]


def test_on_the_axes_given_and_else_on_those_of_a_new_figure(ax: Axes) -> None:
    assert plot.cosine_powers([2], ax=ax) is ax
    try:
        new = plot.cosine_powers([2])
        assert new is not ax
        assert new is plt.gca()
    finally:
        plt.close("all")


def test_powers_of_the_cosine(ax: Axes, tolerance: float) -> None:
    plot.cosine_powers([1, 20], ax=ax)
    assert labels(ax) == ["$n = 1$", "$n = 20$"]
    for n, line in zip((1, 20), ax.lines, strict=True):
        alpha, value = line.get_data()
        assert (alpha[0], alpha[-1]) == (0, 90)
        expected = np.cos(np.radians(alpha)) ** n
        np.testing.assert_allclose(value, expected, atol=10 * tolerance)


def test_lobes_in_polar_form() -> None:
    ax = Figure().add_subplot(projection="polar")
    phong, facets = ds.Phong(0.4, 30), ds.TorranceSparrow(0.1, 0.15)
    plot.lobes({"Phong": phong, "facets": facets}, 0.7, ax=ax)
    first, second, mirror = ax.lines
    for line, lobe in ((first, phong), (second, facets)):
        view, radiance = line.get_data()
        assert np.all(np.diff(view) > 0)
        np.testing.assert_allclose(radiance, gallery.cross_section(lobe, 0.7, view))
    assert first.get_xdata()[np.argmax(first.get_ydata())] == pytest.approx(0.7)
    assert set(mirror.get_xdata()) == {0.7}
    assert ax.get_rmax() >= max(first.get_ydata().max(), second.get_ydata().max())
    straight_up, to_the_right = ax.transData.transform([(0.0, 0.3), (np.pi / 2, 0.3)])
    assert straight_up[1] > to_the_right[1]
    assert straight_up[0] < to_the_right[0]


def test_lobes_on_axes_that_are_not_polar(ax: Axes) -> None:
    with pytest.raises(ds.BadInput, match='projection="polar"'):
        plot.lobes({"Phong": ds.Phong(0.4, 30)}, 0.7, ax=ax)


def test_a_histogram_is_a_density_and_loses_none(ax: Axes, rng: np.random.Generator) -> None:
    drawn = rng.normal(0, 0.02, 2000)
    drawn[:10] = 9.0  # far beyond the axis
    drawn[10:20] = np.nan
    plot.residuals(drawn.reshape(20, 100), noise=0.02, bins=20, ax=ax)
    heights = np.array([bar.get_height() for bar in ax.patches])
    widths = np.array([bar.get_width() for bar in ax.patches])
    assert np.sum(heights * widths) == pytest.approx(1)
    assert heights[-1] * widths[-1] * 1990 == pytest.approx(10)
    x, density = ax.lines[0].get_data()
    assert density.max() == pytest.approx(1 / (0.02 * np.sqrt(2 * np.pi)))
    assert np.trapezoid(density, x) == pytest.approx(1, abs=1e-5)
    middle = [bar.get_x() + bar.get_width() / 2 for bar in ax.patches]
    expected = np.interp(middle, x, density)
    assert np.max(np.abs(heights - expected)) < 0.25 * density.max()


def test_a_histogram_of_nothing(ax: Axes) -> None:
    with pytest.raises(ds.BadInput, match="no finite number"):
        plot.residuals([np.nan], ax=ax)


def test_the_objective_and_what_is_marked(ax: Axes) -> None:
    values, residual = [1.0, 10.0, 100.0], [0.3, 0.1, 0.2]
    plot.objective(values, residual, value=12.0, interval=(9.0, 16.0), true=11.0, ax=ax)
    curve, found, true = ax.lines
    np.testing.assert_array_equal(curve.get_data(), [values, residual])
    assert set(found.get_xdata()) == {12.0}
    assert set(true.get_xdata()) == {11.0}
    (band,) = ax.patches
    box = band.get_path().get_extents(band.get_patch_transform())
    assert (box.x0, box.x1) == pytest.approx((9.0, 16.0))
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
    assert labels(ax) == ["95 % interval", "found: 12", "true: 11"]


def test_an_objective_alone_has_no_legend(ax: Axes) -> None:
    plot.objective([1.0, 2.0], [0.2, 0.1], ax=ax)
    assert ax.get_legend() is None


def test_correlations_cell_by_cell(ax: Axes) -> None:
    matrix = np.array([[1.0, -0.25, np.nan], [-0.25, 1.0, 0.5], [np.nan, 0.5, np.nan]])
    names = ("ka", "kd", "specular.0.shininess")
    plot.correlations(names, matrix, ax=ax)
    shown = ax.images[0].get_array()
    np.testing.assert_array_equal(np.ma.getmaskarray(shown), np.isnan(matrix))
    np.testing.assert_array_equal(shown.filled(np.nan), matrix)
    assert ax.images[0].get_clim() == (-1, 1)
    at = {text.get_position(): text.get_text() for text in ax.texts}
    assert (at[1, 0], at[2, 0], at[2, 1]) == ("-0.25", "?", "0.50")
    assert tuple(tick.get_text() for tick in ax.get_yticklabels()) == names


def test_recovered_over_true(ax: Axes) -> None:
    true = {"kd": 0.5, "specular.0.ks": 0.2}
    found = {"kd": 0.51, "specular.0.ks": 0.19, "specular.0.shininess": 20.0}
    plot.recovered(true, found, {"kd": (0.45, 0.6), "specular.0.ks": (0.1, 0.3)}, ax=ax)
    points = [container.lines[0].get_xydata()[0] for container in ax.containers]
    np.testing.assert_allclose(points, [(1.02, 0), (0.95, 1)])
    ends = [container.lines[2][0].get_segments()[0][:, 0] for container in ax.containers]
    np.testing.assert_allclose(ends, [(0.9, 1.2), (0.5, 1.5)])
    plot.recovered({"n": 2.0}, {"n": 1.0}, {"n": (0.1, np.inf)}, ax=ax)
    np.testing.assert_allclose(ax.containers[-1].lines[2][0].get_segments()[0][:, 0], (0.05, 3))
    with pytest.raises(ds.BadInput, match="is 0"):
        plot.recovered({"kd": 0.0}, {"kd": 0.1}, {"kd": (0.0, 0.2)}, ax=ax)


def test_chromaticities_in_the_triangles_of_screens(ax: Axes) -> None:
    colours, outline = (
        np.array([[0.3, 0.4], [0.5, 0.2]]),
        np.array([[0.1, 0.1], [0.7, 0.2], [0.2, 0.8]]),
    )
    plot.chromaticities(colours, screens={"Rec. 2020": WIDE}, outline=outline, ax=ax)
    triangle, white, closed, points = (line.get_xydata() for line in ax.lines)
    np.testing.assert_array_equal(triangle, [WIDE.red, WIDE.green, WIDE.blue, WIDE.red])
    np.testing.assert_array_equal(white, [WIDE.white])
    np.testing.assert_array_equal(closed, outline[[0, 1, 2, 0]])
    np.testing.assert_array_equal(points, colours)
    assert labels(ax) == ["Rec. 2020"]
    assert ax.get_aspect() == 1


def test_error_against_run_time(ax: Axes) -> None:
    ways = {"float32": [("few", 1.0, 1e-3), ("all", 9.0, 1e-6)], "float64": [("all", 20.0, 0.0)]}
    plot.trade_off(ways, ax=ax)
    first, second = (line.get_xydata() for line in ax.lines)
    np.testing.assert_array_equal(first, [(1.0, 1e-3), (9.0, 1e-6)])
    np.testing.assert_array_equal(second, [(20.0, 1e-12)])
    assert [(text.get_text(), text.xy) for text in ax.texts[:1]] == [("few", (1.0, 1e-3))]
    assert labels(ax) == ["float32", "float64"]
