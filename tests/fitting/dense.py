"""The model written out plainly in NumPy over a sphere, with its whole Jacobian: an independent oracle.

Unknowns are raw: k_a, k_d, k_s in each channel, log n of each lobe, c0, c1, c2, a gain of each light,
I_a. Derivatives are complex steps, exact to rounding.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fitting.degeneracies import Seen, highlight_depths
from fitting.identify import Unidentified, unidentified
from fitting.uncertainty import Uncertainty, propagate


class Minimum(NamedTuple):
    """What `propagate` needs of a fit."""

    k: np.ndarray
    cost: np.ndarray
    information: np.ndarray


@dataclass(frozen=True)
class Plain:
    """A scene and a truth; `lights` are points, or directions where `near` is False.

    `hold` names unknowns that are known: of k "ka", "kd", "ks0"; of the others "n0", "c0", "gain0".
    """

    lights: tuple[tuple[float, float, float], ...]
    near: bool = True
    ka: tuple[float, ...] | None = (0.1,)
    kd: tuple[float, ...] = (0.5,)
    ks: tuple[tuple[float, ...], ...] = ((0.3,),)
    n: tuple[float, ...] = (20.0,)
    c: tuple[float, float, float] | None = None
    gains: bool = False
    ambient: bool = False
    halfway: bool = False
    clamp: bool = False
    plane: bool = False
    separate: bool = False
    hold: tuple[str, ...] = ()
    noise: float = 0.0

    @property
    def plain(self) -> int:
        return 1 if self.ka is None else 2

    @property
    def k(self) -> np.ndarray:
        rows = [*([] if self.ka is None else [self.ka]), self.kd, *self.ks]
        return np.array(rows, float).T

    @property
    def u(self) -> np.ndarray:
        return np.array([value for _, value in self._searched()], float)

    def _searched(self) -> list[tuple[str, float]]:
        return [
            *((f"n{j}", np.log(n)) for j, n in enumerate(self.n)),
            *((f"c{j}", c) for j, c in enumerate(self.c or ())),
            *((f"gain{j}", 1.0) for j in range(len(self.lights) * self.gains)),
            *((("ambient", 1.0),) if self.ambient else ()),
        ]

    @property
    def known(self) -> np.ndarray:
        linear = [
            *([] if self.ka is None else ["ka"]),
            "kd",
            *(f"ks{j}" for j in range(len(self.ks))),
        ]
        of_k = [name in self.hold for name in linear] * len(self.kd)
        return np.array(of_k + [name in self.hold for name, _ in self._searched()])

    def points(self) -> np.ndarray:
        x = (np.arange(32) + 0.5) / 32 * 2.2 - 1.1
        x, y = (plane.ravel() for plane in np.meshgrid(x, -x))
        inside = x**2 + y**2 < 1
        x, y = x[inside], y[inside]
        z = np.zeros_like(x) if self.plane else np.sqrt(1 - x**2 - y**2)
        return np.stack([x, y, z], axis=-1)

    def distances(self) -> np.ndarray:
        """Between lights and the points they light."""
        p = self.points()
        n = np.broadcast_to([0.0, 0, 1], p.shape) if self.plane else p
        towards = np.array(self.lights)[:, None] - p
        lit = (towards * n).sum(-1) > 0
        return np.linalg.norm(towards, axis=-1)[lit]

    def image(self, k: np.ndarray, u: np.ndarray) -> np.ndarray:
        """[C, P], or where `separate` an image a light [C, K P]; complex numbers pass through."""
        value = dict(zip((name for name, _ in self._searched()), u, strict=True))
        p = self.points()
        n = np.broadcast_to([0.0, 0, 1], p.shape) if self.plane else p
        v = np.array([0.0, 0, 1])
        ka = np.zeros(len(k)) if self.ka is None else k[:, 0]
        ambient = np.outer(ka * value.get("ambient", 1.0), np.ones(len(p)))
        shown = []
        for j, light in enumerate(self.lights):
            l = np.array(light) - p if self.near else np.broadcast_to(light, p.shape)
            d = np.linalg.norm(l, axis=-1)
            l = l / d[:, None]
            f: object = 1.0
            if self.c is not None:
                f = 1 / (value["c0"] + value["c1"] * d + value["c2"] * d**2)
                f = np.where(np.real(f) > 1, 1, f) if self.clamp else f
            n_dot_l = (n * l).sum(-1)
            lit = n_dot_l > 0
            if self.halfway:
                peak = (n * (l + v)).sum(-1) / np.linalg.norm(l + v, axis=-1)
            else:
                peak = (2 * n_dot_l[:, None] * n - l) @ v
            log_peak = np.log(np.where(lit & (peak > 0), peak, 1))
            seen = np.outer(k[:, self.plain - 1], np.where(lit, n_dot_l, 0)).astype(complex)
            for m in range(len(self.ks)):
                lobe = np.where(lit & (peak > 0), np.exp(np.exp(value[f"n{m}"]) * log_peak), 0)
                seen += np.outer(k[:, self.plain + m], lobe)
            shown.append(f * value.get(f"gain{j}", 1.0) * seen)
        if self.separate:
            return np.concatenate([ambient + image for image in shown], axis=1)
        return ambient + sum(shown)

    def jacobians(self) -> tuple[np.ndarray, ...]:
        """dI/dk [C, p, P], each channel by its own k; dI/du [C, q, P]."""
        k, u, step = self.k.astype(complex), self.u.astype(complex), 1e-30

        def moved(dk: np.ndarray | float, du: np.ndarray | float) -> np.ndarray:
            return self.image(k + dk, u + du).imag / step

        of_k = [moved(1j * step * np.eye(k.shape[1])[i], 0.0) for i in range(k.shape[1])]
        of_u = [moved(0.0, 1j * step * np.eye(u.size)[i]) for i in range(u.size)]
        shape = (-1, *self.image(k, u).shape)
        return tuple(np.moveaxis(np.reshape(of, shape), 0, 1) for of in (of_k, of_u))

    def dense(self) -> np.ndarray:
        """All derivatives [C P, C p + q]."""
        of_k, of_u = self.jacobians()
        c, p, _ = of_k.shape
        rows = []
        for channel in range(c):
            own = np.zeros((of_k.shape[2], c * p))
            own[:, channel * p : (channel + 1) * p] = of_k[channel].T
            rows.append(np.concatenate([own, of_u[channel].T], axis=1))
        return np.concatenate(rows)

    def minimum(self, dtype: type = np.float64) -> Minimum:
        of_k, of_u = self.jacobians()
        residual = np.random.default_rng(0).normal(0, 1, (len(of_k), 1, of_k.shape[2])) * self.noise
        columns = np.concatenate([of_k, of_u, residual], axis=1).astype(dtype)
        information = np.einsum("cip,cjp->cij", columns, columns)
        return Minimum(self.k.astype(dtype), (residual**2).sum(), information)

    def report(self) -> Callable[..., dict[str, np.ndarray]]:
        names = [name for name, _ in self._searched()]

        def report(k: np.ndarray, u: np.ndarray) -> dict[str, np.ndarray]:
            found = {} if self.ka is None else {"ka": k[..., 0]}
            found["kd"] = k[..., self.plain - 1]
            for j in range(len(self.ks)):
                found[f"specular.{j}.ks"] = k[..., self.plain + j]
            for name, value in zip(names, np.moveaxis(u, -1, 0), strict=True):
                if name[0] == "n":
                    found[f"specular.{name[1:]}.shininess"] = np.exp(value)
                elif name[0] == "c":
                    found[f"attenuation.{name}"] = value
                else:
                    found[name.replace("gain", "gain.")] = value
            return found

        return report

    def uncertainty(self, dtype: type = np.float64, **options: object) -> Uncertainty:
        minimum = self.minimum(dtype)
        observations = minimum.k.shape[0] * self.image(self.k, self.u).shape[1]
        return propagate(
            minimum,
            self.u.astype(dtype),
            self.known,
            observations,
            self.report(),
            **options,  # type: ignore[arg-type]
        )

    def seen(self) -> Seen:
        minimum = self.minimum()
        exponents = {j: j for j in range(len(self.n))}
        depths = highlight_depths(minimum.information, minimum.k, self.plain, exponents)
        if self.c is None:
            return Seen(depths=depths)
        d = self.distances()
        law = self.c[0] + self.c[1] * d + self.c[2] * d**2
        share = float(np.mean(law < 1)) if self.clamp else 0.0
        return Seen(float(d.min()), float(d.max()), share, depths)

    def told(self, dtype: type = np.float64) -> tuple[Unidentified, ...]:
        uncertainty = self.uncertainty(dtype)
        held = {self._full(name) for name in self.hold}
        free = {name: v for name, v in uncertainty.values.items() if name not in held}
        brightest = float(np.real(self.image(self.k, self.u)).max())
        return unidentified(free, uncertainty, brightest, seen=self.seen())

    @staticmethod
    def _full(name: str) -> str:
        kinds = {"ks": "specular.{}.ks", "n": "specular.{}.shininess", "c": "attenuation.c{}"}
        kinds["gain"] = "gain.{}"
        stem = name.rstrip("0123456789")
        return kinds[stem].format(name[len(stem) :]) if stem in kinds else name
