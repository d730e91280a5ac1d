"""Names for the ways in which coefficients trade against each other, each with its remedy.

A `Move` is one direction in which coefficients can go without the images telling. A rule looks at one
and says in words what it is, or None; the first that does is taken. Two moves of one sentence are one.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fitting.shapes import is_shape

__all__ = ["SEEN_NOTHING", "Move", "Seen", "highlight_depths", "say"]

FAR = 1.25
"""The farthest lit point over the nearest, under which a light is far: its distance hardly varies."""
FLANK = 1.5
"""How deep a lobe's light lies on average (`Seen.depths`) when its peak is not seen."""


@dataclass(frozen=True)
class Seen:
    """What a few numbers say of what the images show.

    - `nearest`, `farthest`: the least and the greatest distance between lit points and the lights
      whose attenuation is fitted; None where none is.
    - `clamped`: the share of lit points at which the fitted law is clamped at f = 1, in [0, 1].
    - `depths`: of each lobe the mean of n log(1 / r.v) over its light: a highlight seen whole has
      1/2, one of which only the flank is seen more; NaN where not known (`highlight_depths`).
    """

    nearest: float | None = None
    farthest: float | None = None
    clamped: float = 0.0
    depths: tuple[float, ...] = ()


SEEN_NOTHING = Seen()


@dataclass(frozen=True)
class Move:
    """Coefficients that move together by `relative` of their values, and how much is known of them.

    `relative` is NaN for a value of 0. `errors` are the relative errors of those that move, infinite
    where the images do not tell; `values` has every coefficient. Names are those of `Fit`, those of
    k_d and k_s without "reference.".
    """

    relative: Mapping[str, np.ndarray]
    errors: Mapping[str, float]
    values: Mapping[str, np.ndarray]
    seen: Seen

    @cached_property
    def names(self) -> frozenset[str]:
        return frozenset(self.relative)

    @cached_property
    def gains(self) -> tuple[str, ...]:
        return tuple(sorted(name for name in self.names if name.startswith("gain.")))

    @cached_property
    def constants(self) -> tuple[str, ...]:
        """c0, c1, c2, or l0, l1, l2 at the reference distance."""
        return tuple(sorted(n for n in self.names if n.startswith("attenuation.") or _is_share(n)))

    @cached_property
    def reflected(self) -> tuple[str, ...]:
        """k_d and each k_s: what multiplies a light."""
        return tuple(sorted(n for n in self.names if n == "kd" or n.endswith(".ks")))

    @cached_property
    def lobes(self) -> tuple[str, ...]:
        """The lobes of which something moves: "specular.0"."""
        return tuple(
            sorted({".".join(n.split(".")[:2]) for n in self.names if n.startswith("specular.")})
        )

    @cached_property
    def shapes(self) -> frozenset[str]:
        """What shapes a lobe or a body: exponents, roughnesses, refractive indices."""
        return frozenset(name for name in self.names if is_shape(name))

    @cached_property
    def others(self) -> frozenset[str]:
        """What is neither gain, nor constant, nor reflected."""
        return self.names - {*self.gains, *self.constants, *self.reflected}

    def is_one_scale(self, names: tuple[str, ...]) -> bool:
        """Whether they all grow by the same share, those that are 0 left aside."""
        steps = np.concatenate([self.relative[name].ravel() for name in names])
        steps = steps[~np.isnan(steps)]
        return steps.size > 0 and bool(np.ptp(steps) <= 0.1 * np.max(np.abs(steps)))


def say(move: Move) -> str:
    """What the move is, and the remedy, in one sentence."""
    for rule in RULES:
        sentence = rule(move)
        if sentence is not None:
            return sentence
    raise AssertionError("the last rule knows every move")


def highlight_depths(
    information: np.ndarray, k: np.ndarray, plain: int, exponents: Mapping[int, int]
) -> tuple[float, ...]:
    """`Seen.depths` from Gram matrices [C, s, s] of [A, J, r] at k [C, p].

    The columns are `plain` of k_a and k_d, and those of the lobes; of a lobe's log n `exponents` says
    the row of J. That derivative is k_s n log(r.v) times the lobe's own column, so that one product
    over another is the mean of n log(r.v), weighted by the lobe squared: -1/2 over a whole peak, as
    exp(-s) squared has the mean 1/2 over its s = n theta^2 / 2.
    """
    lobe_count = k.shape[1] - plain
    depths = [float("nan")] * lobe_count
    for lobe, row in exponents.items():
        column, derivative = plain + lobe, k.shape[1] + row
        light = float((k[:, column] ** 2 * information[:, column, column]).sum())
        if light > 0:
            crossed = (k[:, column] * information[:, column, derivative]).sum()
            depths[lobe] = -float(crossed) / light
    return tuple(depths)


def _gains(move: Move) -> str | None:
    """I_p against k_d, k_s and the attenuation: every gain one way, what it multiplies the other."""
    if not move.gains:
        return None
    if len(move.names) == 1:
        return f"no used pixel shows that light: hold {move.gains[0]}, or leave the light out"
    if not move.is_one_scale(move.gains) or not (move.reflected or move.constants):
        if move.names == set(move.gains):
            return "these lights light the surface alike: hold the gain of all of them but one"
        return None
    return gain_sentence(move.reflected + move.constants)


def gain_sentence(names: tuple[str, ...]) -> str:
    """Of the lights' gains and what they multiply, where nothing that is held sets their scale."""
    return (
        f"the lights' gains share one scale with {_list(_texts(names))}: twice the light on a surface"
        " that reflects half as much gives the same images: hold one of these, or take the mean gain"
        " of 1 for granted"
    )


def _ambient(move: Move) -> str | None:
    """I_a against k_a."""
    if not {"ka", "ambient"} <= move.names:
        return None
    return (
        "only the product of I_a and k_a is seen: measure I_a and hold it, or hold k_a; or read"
        " k_a as I_a k_a with I_a = 1"
    )


def _scale(move: Move) -> str | None:
    """c0, c1, c2 against k_d, k_s, all by the same share."""
    laws = tuple(name for name in move.constants if name.startswith("attenuation."))
    if not (laws and move.reflected and not move.others):
        return None
    present = {n for n, v in move.values.items() if n.startswith("attenuation.") and np.any(v != 0)}
    moving = tuple(name for name in laws if name in present)
    if not (moving and present <= move.names and move.is_one_scale(moving + move.reflected)):
        return None
    return scale_sentence(move.reflected + laws)


def scale_sentence(names: tuple[str, ...]) -> str:
    """Of k_d, k_s and c0, c1, c2, where nothing that is held or clamped sets their scale."""
    return (
        f"{_list(_texts(names))} share one scale, which no image can tell: hold one of them, or use"
        " their ratios, and kd and ks at the reference distance, which are what was measured"
    )


def _unlit(move: Move) -> str | None:
    """An attenuation of light that is not reflected."""
    reflected = [v for n, v in move.values.items() if n == "kd" or n.endswith(".ks")]
    if not move.constants or move.reflected or any(np.any(value != 0) for value in reflected):
        return None
    return (
        "kd and ks are 0, and light that is not reflected shows no attenuation: take the scene's as"
        " known (attenuation=None), or add images in which the lights are seen"
    )


def _attenuation(move: Move) -> str | None:
    """c1, c2 of a far light, or of distances that are too few to tell a law by."""
    if not move.constants:
        return None
    near, far = move.seen.nearest, move.seen.farthest
    if near is None or far is None:
        return (
            f"{_list(_texts(move.constants))} are told only in combination: use lights at more"
            " distances, or hold one of them"
        )
    if far < FAR * near:
        return (
            f"the lights are far: their distances vary by {100 * (far / near - 1):.2g} % only, over"
            " which every law looks alike: add images with a light near by, or hold c1 and c2"
        )
    return (
        f"distances of {near:.3g} to {far:.3g} are too few to tell c0, c1 and c2 apart: add images"
        " with lights nearer and farther, or hold one of them"
    )


def _coinciding_lobes(move: Move) -> str | None:
    """Two lobes of one shape."""
    if len(move.lobes) < 2 or move.others - _widths(move):
        return None
    widths = {lobe: _width(move, lobe) for lobe in move.lobes}
    if len(set(widths.values())) > 1:
        return None  # of different kinds, which trade otherwise
    name = widths[move.lobes[0]]
    shown = [f"{float(np.mean(move.values[f'{lobe}.{name}'])):.3g}" for lobe in widths]
    return (
        f"{_list(move.lobes)} have the same shape ({name} {_list(shown)}), and only the sum of"
        f" their ks is told: leave one of them out, or hold its {name} at another value"
    )


def _zero_lobe(move: Move) -> str | None:
    """n of a lobe whose k_s is 0, or no more than its error."""
    if len(move.lobes) != 1 or not _within_lobe(move):
        return None
    lobe = move.lobes[0]
    ks = move.values.get(f"{lobe}.ks")
    name = _width(move, lobe)
    if ks is None or np.any(ks != 0) or f"{lobe}.{name}" not in move.names:
        return None
    return (
        f"{lobe}.ks is 0, and a highlight that is not seen has no width (one so narrow that it falls"
        f" between the pixels would look the same): leave the lobe out, or hold its {name}"
    )


def _like_diffuse(move: Move) -> str | None:
    """k_d against k_s: a lobe as broad as diffuse reflection, as with a light at the viewer."""
    if "kd" not in move.names or not move.lobes or not _is_shading(move) or "ka" in move.names:
        return None
    return (
        f"the highlight of {_list(move.lobes)} has the shape of the diffuse term in these images, as"
        " when it is broad and the light stands at the viewer (a headlight): add an image with a"
        " light from the side, or hold kd or ks"
    )


def _like_ambient(move: Move) -> str | None:
    """k_a against k_d or k_s: shading that is the same wherever one looks, as on a flat surface."""
    if "ka" not in move.names or len(move.names) == 1 or not _is_shading(move):
        return None
    terms = (("n.l",) if "kd" in move.names else ()) + (("r.v",) if move.lobes else ())
    return (
        f"{_list(terms)} {'varies' if len(terms) == 1 else 'vary'} too little over the used pixels,"
        " and what the lights add looks like the ambient light: add an image with a light from"
        " another direction, or with none, or hold ka"
    )


def _boundary(move: Move) -> str | None:
    """The index of refraction, or what else a boundary has, against kd and ks."""
    of_boundary = tuple(sorted(move.shapes - _widths(move)))
    if not of_boundary or move.others - move.shapes or move.gains or move.constants:
        return None
    if not move.reflected:
        return None
    return (
        f"{_list(of_boundary)} and {_list(_texts(move.reflected))} change these images alike: F hardly"
        " varies over what is seen: add lights and views at grazing angles, or hold"
        f" {of_boundary[0]}"
    )


def _no_highlight(move: Move) -> str | None:
    """k_s and n of a lobe whose peak no pixel shows, or too few."""
    if len(move.lobes) != 1 or not _within_lobe(move):
        return None
    lobe = move.lobes[0]
    index = int(lobe.split(".")[1])
    depth = move.seen.depths[index] if index < len(move.seen.depths) else np.nan
    if len(move.names) == 1 and np.isinf(move.errors[min(move.names)]):
        if not np.isnan(depth):
            return None
        return (
            f"no used pixel shows any of {lobe}: add an image in which the highlight lies on the"
            " surface, or leave the lobe out"
        )
    if depth > FLANK:
        return (
            f"no highlight is seen: only the flank of {lobe}, at {np.exp(-depth):.1g} of its peak,"
            " lies on used pixels: add an image with the light where it is mirrored to the viewer,"
            f" or hold the {_width(move, lobe)}"
        )
    weak = max(move.errors.values())
    return (
        f"too little of the highlight of {lobe} is seen ({_error(weak)}): a small ks, or a peak"
        f" between pixels: add images or lights that show it, or hold the {_width(move, lobe)}"
    )


def _alone(move: Move) -> str | None:
    """One coefficient by itself."""
    if len(move.names) != 1:
        return None
    error = next(iter(move.errors.values()))
    if np.isinf(error):
        return "no pixel depends on it: leave it out, hold it, or add images that show it"
    return f"{_error(error)}: add images or lights, or hold it"


def _combination(move: Move) -> str | None:
    """Anything else."""
    names = sorted(move.names)
    if all(np.isinf(error) for error in move.errors.values()):
        return f"the images show only a combination of them: hold {' or '.join(names[:3])}"
    error = _error(max(move.errors.values()))
    return f"they trade against each other, and {error}: add images or lights, or hold one of them"


RULES: tuple[Callable[[Move], str | None], ...] = (
    _ambient,
    _gains,
    _scale,
    _unlit,
    _attenuation,
    _coinciding_lobes,
    _zero_lobe,
    _like_diffuse,
    _like_ambient,
    _boundary,
    _no_highlight,
    _alone,
    _combination,
)


def _within_lobe(move: Move) -> bool:
    lobe = move.lobes[0]
    return move.names <= {f"{lobe}.ks", f"{lobe}.{_width(move, lobe)}"}


def _is_shading(move: Move) -> bool:
    """Whether only a material's own coefficients move."""
    return not (move.gains or move.constants or move.others - _widths(move) - {"ka"})


def _widths(move: Move) -> set[str]:
    return {f"{lobe}.{_width(move, lobe)}" for lobe in move.lobes}


def _width(move: Move, lobe: str) -> str:
    """What says how wide a lobe is: its exponent or its roughness."""
    return "alpha" if f"{lobe}.alpha" in move.values else "shininess"


def _is_share(name: str) -> bool:
    return name in ("reference.l0", "reference.l1", "reference.l2")


def _error(error: float) -> str:
    size = f"{100 * error:.0f} %" if error < 10 else "more than its value"
    return (
        f"its standard error is {size} for noise of a thousandth of the images' maximum, or for the"
        " noise found"
    )


def _texts(names: tuple[str, ...]) -> list[str]:
    """As the texts write them: "attenuation.c0" is c0."""
    return [name.removeprefix("attenuation.").removeprefix("reference.") for name in names]


def _list(names: list[str] | tuple[str, ...]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
