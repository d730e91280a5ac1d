"""Every hard scene ends in what is due, and one that does not is seen."""

import math

import numpy as np
import pytest
from stress import recoveries
from stress.hard_scene import HARMLESS, HardScene, tried
from stress.pictures import LAMP, PLAIN, everywhere, rendered
from stress.recoveries import LAMPS, fitted
from stress.score import scenes

import fitting


@pytest.mark.slow
@pytest.mark.parametrize(
    "scene", [pytest.param(s, id=f"{task}: {s.name}") for task, s in scenes() if not s.large]
)
def test_a_hard_scene_ends_in_what_is_due(scene: HardScene) -> None:
    assert scene.due in HARMLESS
    verdict = tried(scene)
    assert verdict.kind == scene.due, verdict.detail


def test_a_wrong_picture_is_seen() -> None:
    attempt = rendered(LAMP, known=everywhere(0.05))
    assert tried(HardScene("another image", "right", attempt)).kind == "wrong"


def test_a_wrong_number_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fits that err, are sure of nothing, or hold what is no number."""
    scene = HardScene("a ball", "right", fitted(LAMPS[:2], size=24))
    assert tried(scene).kind == "right"
    fit = fitting.fit

    def changed(**values: object) -> None:
        def found(*arguments: object, **options: object) -> object:
            true = fit(*arguments, **options)  # type: ignore[arg-type]
            return _Changed(true, values)

        monkeypatch.setattr(recoveries.fitting, "fit", found)

    for name, value in PLAIN.items():
        own = {"ks": "specular.0.ks", "shininess": "specular.0.shininess"}.get(name, name)
        changed(coefficients={own: np.array(1.02 * value)})
        assert tried(scene).kind == "wrong"
    changed(coefficients={"kd": np.array(math.nan)})
    assert tried(scene).kind == "not finite"
    changed(converged=False)
    assert tried(scene).kind == "wrong"
    everything = fitting.found.Unidentified(
        ("ka", "kd", "specular.0.ks", "specular.0.shininess"), ""
    )
    changed(unidentified=(everything,))
    assert tried(scene).kind == "wrong"
    changed(steps=10**6)
    assert tried(scene).kind == "too slow"


class _Changed:
    """A fit with other attributes; `coefficients` are changed one by one."""

    def __init__(self, fit: fitting.Fit, values: dict[str, object]) -> None:
        own = values.pop("coefficients", {})
        self.fit, self.values = fit, values | {"coefficients": {**fit.coefficients, **own}}  # type: ignore[dict-item]

    def __getattr__(self, name: str) -> object:
        return self.values[name] if name in self.values else getattr(self.fit, name)
