"""Hard scenes to fit: photographs by the plain model, with noise, and what the fit says of each number.

A number is right where it lies within four of its standard errors of the true one, within a thousandth
of it, or within 1e-4; it is not told where the fit names it in `unidentified`. What is neither is wrong,
as is a fit that did not converge and tells numbers.
"""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from stress.hard_scene import HardScene, Verdict, precision, timed
from stress.pictures import PLAIN, but, exact, from_afar, light, masked, scene_of, with_one_lit

import diffshade as ds
import fitting

__all__ = ["SCENES"]

STEPS = 200
"""What a fit may take."""
NOISE = 1e-4
LAW = (1.0, 0.1, 0.05)
NAMES = {"ka": "ka", "kd": "kd", "specular.0.ks": "ks", "specular.0.shininess": "shininess"}
ALL = tuple(NAMES)
LAMPS = tuple(
    light(place, LAW)
    for place in ((0.8, 0.5, 2.5), (-1.0, 0.8, 2.0), (0.0, -1.0, 3.0), (1.0, 1.0, 1.6))
)


def judged(fit: fitting.Fit, truth: dict[str, float], told: Iterable[str]) -> Verdict:
    """Of every number of a fit; `told` are those that the photographs do tell."""
    untold = {name for item in fit.unidentified for name in item.coefficients}
    numbers = [*fit.coefficients.values(), fit.relative_residual, fit.noise]
    if not all(np.isfinite(number).all() for number in numbers):
        return Verdict("not finite", f"{dict(fit.coefficients)}")
    if fit.steps > STEPS:
        return Verdict("too slow", f"{fit.steps} steps")
    wrong, said = [], []
    for name, found in fit.coefficients.items():
        if name in untold or name not in truth:
            continue
        error = float(np.abs(found - truth[name]).max())
        bound = max(
            4 * float(np.max(fit.standard_errors.get(name, 0.0))), 1e-3 * abs(truth[name]), 1e-4
        )
        if not error <= bound:
            wrong.append(f"{name} = {np.ravel(found)[0]:.5g}, not {truth[name]:g}")
        said.append(name)
    missing = sorted(set(told) - set(said))
    if wrong or not (fit.converged or not said):
        return Verdict("wrong", "; ".join(wrong) or "not converged")
    if missing:
        return Verdict("wrong", f"{', '.join(missing)} not told, though the photographs do")
    rest = sorted(untold & set(fit.coefficients))
    if rest:
        return Verdict("not identified", f"{', '.join(rest)}; right: {', '.join(said)}")
    return Verdict("right", f"{len(said)} numbers, {fit.steps} steps")


def fitted(
    lights: Iterable[Any] = LAMPS,
    plain: dict[str, float] = PLAIN,
    *,
    told: Iterable[str] = ALL,
    ambient: float | None = 0.5,
    size: int = 48,
    change: Callable[[ds.GBuffer], ds.GBuffer] = lambda g: g,
    exposure: float = 1.0,
    law: Any = None,
) -> Callable[[], Verdict]:
    """A photograph a light, clipped at 1 after an exposure, and the fit of them all.

    `exposure` is a factor on image and lights alike, but for what it clips; `law` is fitted.
    """

    def attempt() -> Verdict:
        gbuffer = change(ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(size, size, 2.2)))
        rng = np.random.default_rng(0)
        photographs, clipped, scenes = [], [], []
        for each in lights:
            image = exact(gbuffer, [each], plain, ambient)
            image += np.asarray(gbuffer.mask)[..., None] * rng.normal(0, NOISE, image.shape)
            seen = exposure * image
            photographs.append((np.minimum(seen, 1.0) / exposure).astype(precision()))
            clipped.append(seen >= 1.0)
            scenes.append(scene_of([each], ambient))
        found, seconds = timed(
            lambda: fitting.fit(photographs, gbuffer, scenes, clipped=clipped, attenuation=law)
        )
        truth = {name: plain[own] for name, own in NAMES.items()}
        return judged(found, truth, told)._replace(seconds=seconds)

    return attempt


def afar(*directions: Any) -> list[dict[str, Any]]:
    """Parallel lights."""
    return [from_afar(direction) for direction in directions]


def under(law: Any, lamps: Iterable[dict[str, Any]] = LAMPS) -> list[dict[str, Any]]:
    """The lamps with another law."""
    return [light(lamp["position"], law) for lamp in lamps]


FAR = [light((1e6 * x, 1e6 * y, 8e5)) for x, y in ((0.6, 0), (-0.3, 0.5), (0, -0.6), (0.2, 0.2))]
BEHIND = 4 * afar((0.0, 0.0, -1.0))

SCENES = (
    HardScene("four lamps", "right", fitted()),
    HardScene(
        "grazing light",
        "right",
        fitted(afar(*((x, y, 1e-3) for x, y in ((1, 0), (-1, 0.2), (0, 1), (-0.3, -1))))),
    ),
    HardScene(
        "highlight of one pixel, n = 1e5",
        "not identified",
        fitted(4 * afar((0.0, 0.0, 1.0)), but(shininess=1e5), told=("ka", "kd"), size=49),
    ),
    HardScene("n = 1", "right", fitted(plain=but(shininess=1.0))),
    HardScene("n = 1e5", "right", fitted(plain=but(shininess=1e5), size=1024)),
    HardScene("no highlight", "not identified", fitted(plain=but(ks=0.0), told=("ka", "kd"))),
    HardScene("all clipped", "not identified", fitted(exposure=1e3, told=())),
    HardScene(
        "all in shadow",
        "not identified",
        fitted(BEHIND, told=("ka",)),
    ),
    HardScene(
        "all in shadow, no ambient",
        "not identified",
        fitted(BEHIND, told=(), ambient=None),
    ),
    HardScene(
        "light at the surface",
        "right",
        fitted([*LAMPS[:3], light((0.6, 0.0, 0.8), LAW)]),
    ),
    HardScene("light at 1e6", "right", fitted(under((1.0, 0.0, 0.0), FAR))),
    HardScene("constants of attenuation almost zero", "right", fitted(under((1e-6, 0.0, 0.0)))),
    HardScene(
        "constants of attenuation huge",
        "not identified",
        fitted(under((1e6, 1e6, 1e6)), told=("ka",)),
    ),
    HardScene(
        "constants to be found where there is none",
        "not identified",
        fitted(under(None), law=ds.QuadraticAttenuation, told=("ka", "specular.0.shininess")),
    ),
    HardScene(
        "coefficients at their bounds",
        "right",
        fitted(plain=but(ka=0.0, kd=1.0, ks=1.0)),
    ),
    HardScene(
        "coefficients of 0", "not identified", fitted(plain=but(ka=0.0, kd=0.0, ks=0.0), told=())
    ),
    HardScene(
        "one lit pixel",
        "not identified",
        fitted(4 * afar((0.0, 0.0, 1.0)), change=with_one_lit, told=("ka",)),
    ),
    HardScene("empty mask", "refused", fitted(change=masked())),
    HardScene("mask of one pixel", "not identified", fitted(change=masked((22, 26)), told=())),
    HardScene("1 x 1", "not identified", fitted(size=1, told=())),
    HardScene("ten identical lights", "right", fitted(10 * LAMPS[:1])),
    HardScene("8192 x 8192", "right", fitted(LAMPS[:1], size=8192), large=True),
)
