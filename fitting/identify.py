"""What the images cannot tell, in words, and what to do about it.

A coefficient is identified when its Cramer-Rao error, for noise of a thousandth of the images' maximum
or the noise found if that is more, is under a tenth of its size. Those that are not are grouped by the
directions in which they move together: the null directions of the information matrix, and the axes
of the covariance that are too long. Made sparse, each is given its name by `fitting.degeneracies`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fitting.degeneracies import SEEN_NOTHING, Move, Seen, gain_sentence, say, scale_sentence
from fitting.null_space import sparse_basis
from fitting.uncertainty import Uncertainty

__all__ = ["Unidentified", "unidentified"]

NOISE = 1e-3
"""Of the images' maximum: the noise under which a coefficient must be known ..."""
TOLERANCE = 0.10
"""... to this share of its size, to count as identified."""
LEAST_SHARE = 0.01
"""The least size of a linear coefficient, as a share of the largest: one that is 0 is known by this."""
EVEN = 1 / 3
"""The least size of c0, c1 d and c2 d^2, as a share of their sum."""
CONSTANTS = ("attenuation.c0", "attenuation.c1", "attenuation.c2")
SLIGHT = 0.2
"""What moves by less than this share of what moves most is not named as part of a weak direction."""
CLAMPED = (
    "f is clamped at 1 at every lit point, which tells only that c0 + c1 d + c2 d^2 <= 1 there: move"
    " the lights away, or hold the constants"
)
FLAT = (
    "f is the same at every lit point: without attenuation, or clamped at 1 everywhere, which would"
    " tell only that c0 + c1 d + c2 d^2 <= 1 there: move the lights away, or hold the constants"
)


@dataclass(frozen=True)
class Unidentified:
    """Coefficients that the images do not determine, and why."""

    coefficients: tuple[str, ...]
    reason: str


def unidentified(
    values: Mapping[str, np.ndarray],
    uncertainty: Uncertainty,
    brightest: float,
    *,
    scaled: bool = False,
    gains: tuple[str, ...] = (),
    seen: Seen = SEEN_NOTHING,
) -> tuple[Unidentified, ...]:
    """Judge every coefficient in `values`, those that are not held.

    `brightest` is the images' maximum. `scaled` says that attenuation constants were fitted, and that
    nothing held sets the scale that they share with k_d and k_s; then those at the reference distance
    are judged. `gains` names the lights' gains where these were fitted to a mean of 1, a convention, and
    nothing that is held sets their scale. `seen` helps to say why.
    """
    # A clamp that acts at some points and not at others sets the scale; at every point, it tells none
    # of c0, c1, c2.
    scaled = scaled and seen.clamped == 0
    judged = [name for name in values if _is_judged(name, values, scaled)]
    if seen.clamped >= 1:
        judged = [name for name in judged if name not in CONSTANTS]
    found = _vague(judged, values, uncertainty, max(NOISE * brightest, uncertainty.noise), seen)
    laws = tuple(name for name in values if name in CONSTANTS)
    if seen.clamped >= 1 and laws:
        found.append(Unidentified(laws, CLAMPED))
    if scaled and _is_flat(values, uncertainty, max(NOISE * brightest, uncertainty.noise)):
        found.append(Unidentified(laws, FLAT))
    plain = tuple(n for n in values if _is_linear(n) and n != "ka" and "reference" not in n)
    if gains:
        found.append(Unidentified((*plain, *gains), gain_sentence(plain)))
    if scaled:
        found.append(Unidentified((*plain, *laws), scale_sentence((*plain, *laws))))
    return tuple(found)


def _vague(
    judged: list[str],
    values: Mapping[str, np.ndarray],
    uncertainty: Uncertainty,
    noise: float,
    seen: Seen,
) -> list[Unidentified]:
    """Those that are known to less than the tolerance, in groups."""
    sizes = _sizes(judged, values, uncertainty.values, seen)
    relative = {}
    for name in judged:
        with np.errstate(divide="ignore", invalid="ignore"):
            error = noise * uncertainty.unit_errors[name] / sizes[name]
        relative[name] = np.where(np.isnan(error), np.inf, error)
    vague = {n: float(e.max()) for n, e in relative.items() if e.size and e.max() > TOLERANCE}
    if not vague:
        return []

    sentences: dict[str, list[str]] = {}
    rest = dict.fromkeys(vague)
    told: list[tuple[Steps, str]] = []
    for direction in _directions(judged, sizes, uncertainty, noise):
        share = {name: float(np.abs(direction.shares[name]).max()) for name in vague}
        moving = {n: direction.steps[n] for n in vague if share[n] > direction.least}
        if moving:
            reason = say(_move(moving, vague, uncertainty.values, seen))
            sentences.setdefault(reason, []).extend(moving)
            told.append((direction.shares, reason))
            rest = {name: None for name in rest if name not in moving}
    for name in rest:
        # One that has a slight part in some is named with the direction in which it has the most.
        most, reason = max(((np.abs(s[name]).max(), r) for s, r in told), default=(0.0, ""))
        if most == 0:
            reason = say(_move({name: sizes[name]}, vague, uncertainty.values, seen))
        sentences.setdefault(reason, []).append(name)
    order = list(values)
    return [
        Unidentified(
            tuple(sorted({*names, *_constants_of(names, values)}, key=order.index)), reason
        )
        for reason, names in sentences.items()
    ]


Steps = dict[str, np.ndarray]


class Direction(NamedTuple):
    """Steps of the judged coefficients that go together, by name.

    `shares` are the same in units of what each would change in the images, the largest 1: a share over
    `least` is part of the direction.
    """

    steps: Steps
    shares: Steps
    least: float


def _directions(
    judged: list[str], sizes: Mapping[str, np.ndarray], uncertainty: Uncertainty, noise: float
) -> list[Direction]:
    """In which the judged coefficients can move: first without, then with little change of the images."""
    parts = np.cumsum([value.size for value in uncertainty.values.values()])
    place = dict(zip(uncertainty.values, np.split(np.arange(parts[-1]), parts[:-1]), strict=True))
    at = np.concatenate([place[name] for name in judged])
    order = np.concatenate([np.full(sizes[name].size, _rank(name), float) for name in judged])
    size = np.concatenate([sizes[name].ravel() for name in judged])
    size = np.where(size > 0, size, 1.0)[:, None]
    reach = uncertainty.reach[at, None]
    reach = np.where(reach > 0, reach, 1.0)

    axes, lengths, _ = np.linalg.svd(noise * uncertainty.unit_root[at] / size, full_matrices=False)
    blind = uncertainty.blind[at] / reach
    blind = sparse_basis(blind[:, np.abs(blind).max(axis=0, initial=0) > 0], order)
    weak = sparse_basis(axes[:, lengths > TOLERANCE] * size / reach, order, beside=blind)

    ends = np.cumsum([sizes[name].size for name in judged])[:-1]

    def by_name(vector: np.ndarray) -> Steps:
        split = zip(judged, np.split(vector, ends), strict=True)
        return {name: part.reshape(sizes[name].shape) for name, part in split}

    return [
        Direction(by_name(vector * reach[:, 0]), by_name(vector), least)
        for vectors, least in ((blind, 0.0), (weak, SLIGHT))
        for vector in vectors.T
    ]


def _move(
    steps: Mapping[str, np.ndarray],
    errors: Mapping[str, float],
    values: Mapping[str, np.ndarray],
    seen: Seen,
) -> Move:
    """With k_d and k_s at the reference distance under the names that they have without one."""
    relative = {
        _plain(name): np.asarray(step / np.where(values[name] == 0, np.nan, values[name]))
        for name, step in steps.items()
    }
    return Move(relative, {_plain(name): errors[name] for name in steps}, values, seen)


def _sizes(
    judged: list[str],
    values: Mapping[str, np.ndarray],
    everything: Mapping[str, np.ndarray],
    seen: Seen,
) -> dict[str, np.ndarray]:
    """What an error is compared with: the value, but no less than matters beside the others."""
    sizes = {name: np.abs(np.asarray(values[name], np.float64)) for name in judged}
    largest = max((sizes[n].max(initial=0.0) for n in judged if _is_linear(n)), default=0.0)
    for name in judged:
        if _is_linear(name):
            sizes[name] = np.maximum(sizes[name], LEAST_SHARE * largest)
        elif name.startswith("reference.l"):
            sizes[name] = np.maximum(sizes[name], EVEN)
        elif name in CONSTANTS and seen.nearest is not None and seen.farthest is not None:
            d = np.sqrt(seen.nearest * seen.farthest)
            # A linear law has no c2.
            total = sum(float(everything.get(c, 0)) * d**k for k, c in enumerate(CONSTANTS))
            sizes[name] = np.maximum(sizes[name], EVEN * total / d ** CONSTANTS.index(name))
    return {name: np.asarray(size) for name, size in sizes.items()}


def _is_judged(name: str, values: Mapping[str, np.ndarray], scaled: bool) -> bool:
    """Of k_d, k_s and the constants either those at the reference distance, or the plain ones."""
    if "reference." in name:
        return scaled
    if name in CONSTANTS:
        return not scaled
    return not (scaled and f"reference.{name}" in values)


def _is_flat(values: Mapping[str, np.ndarray], uncertainty: Uncertainty, noise: float) -> bool:
    """Whether a quadratic law is known not to fall with the distance."""
    errors = [noise * uncertainty.unit_errors.get(f"reference.l{k}", np.inf) for k in (1, 2)]
    return bool(
        max(errors) <= TOLERANCE * EVEN
        and all(values[f"reference.l{k}"] <= 2 * error for k, error in enumerate(errors, 1))
    )


def _rank(name: str) -> int:
    """The order in which names are made pivots, so that scales come apart: gains, constants, others."""
    ranks = (name.startswith("gain."), name in CONSTANTS or name.startswith("reference.l"))
    return 0 if ranks[0] else 1 if ranks[1] else 2 if name == "ambient" else 3


def _constants_of(names: list[str], values: Mapping[str, np.ndarray]) -> list[str]:
    """c1 beside l1: what is not known at the reference distance is not known elsewhere."""
    constants = [n.replace("reference.l", "attenuation.c") for n in names if "reference.l" in n]
    return [name for name in constants if name in values]


def _plain(name: str) -> str:
    return name.removeprefix("reference.") if _is_linear(name) else name


def _is_linear(name: str) -> bool:
    return name.removeprefix("reference.") in ("ka", "kd") or name.endswith(".ks")
