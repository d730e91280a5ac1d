"""One fit over several devices or processes: the same result, and a clear end if one is lost."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from queue import Queue
from time import monotonic
from typing import Any

import jax
import numpy as np
import pytest
from command_line import HEAD, KA, KD, KS, LIGHTS, SHININESS, image_entry, light
from forced_devices import printed
from jax.sharding import Mesh

import diffshade as ds
import fitting
from diffshade.cli import run
from diffshade.commands import processes
from diffshade.commands.processes import LOST, Team, team_of
from diffshade.errors import BadInput
from diffshade.io.image import write_png

SLACK = 60.0
"""Seconds that a busy machine may add to what is stated."""
EIGHT = """
import json, sys
import jax, numpy as np
import diffshade as ds, fitting

jax.config.update("jax_enable_x64", True)
size, rng = 160, np.random.default_rng(3)
g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(size, size, 2.2))
lamps = (ds.ParallelLight((-1, 1, 2)), ds.PointLight((1, 2, 3), 1.0))
scenes = [ds.Scene(1.0, lamp) for lamp in (lamps[:1], lamps[1:], lamps)]
material = ds.Material(ka=(0.1, 0.2, 0.1), kd=(0.6, 0.5, 0.3), specular=ds.Phong(0.3, 20))
images = [
    np.asarray(ds.render(g, s, material)) + rng.normal(0, 0.01, (size, size, 3)) for s in scenes
]
images[0][70:90, 70:90] = 0  # a shadow that nobody modelled
devices = jax.devices()
assert len(devices) == 8
tables = []
for options in ({}, {"robust": "tukey"}):
    fits = [fitting.fit(images, g, scenes, devices=d, **options) for d in (None, devices, devices[5:])]
    tables.append(
        [
            {
                **{name: value.tolist() for name, value in f.coefficients.items()},
                **{"error " + name: value.tolist() for name, value in f.standard_errors.items()},
                "residuals": [image.relative_residual for image in f.per_image],
                "steps": f.steps,
            }
            for f in fits
        ]
    )
print(json.dumps(tables))
"""


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A ball of more than one block of pixels, under two lights."""
    folder, size = tmp_path_factory.mktemp("ball"), 100
    g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(size, size, 2.2))
    material = ds.Material(KA, KD, ds.Phong(KS, SHININESS))
    for k, direction in enumerate(LIGHTS):
        scene = ds.Scene(ambient=1.0, lights=ds.ParallelLight(direction))
        image = np.clip(np.asarray(ds.render(g, scene, material)), 0, 1)
        write_png(folder / f"{k}.png", image, bits=16)
    entries = (image_entry(f"{k}.png", light(direction)) for k, direction in enumerate(LIGHTS))
    head = HEAD.replace("width = 40, height = 40", f"width = {size}, height = {size}")
    (folder / "capture.toml").write_text(head + "".join(entries))
    return folder / "capture.toml"


@pytest.mark.slow
def test_eight_devices_are_one() -> None:
    for alone, *shared in printed(EIGHT, devices=8):
        for other in shared:
            for name, value in alone.items():
                np.testing.assert_allclose(other[name], value, rtol=1e-9, atol=1e-14, err_msg=name)


def test_a_mesh_of_one_device_is_the_same_program(tolerance: float) -> None:
    g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(24, 24, 2.2))
    scene = ds.Scene(lights=ds.ParallelLight((1, 1, 2)))
    image = ds.render(g, scene, ds.Material(kd=0.6, specular=ds.Phong(0.3, 20)))
    alone = fitting.fit(image, g, scene)
    for devices in (jax.devices()[:1], Mesh(np.array(jax.devices()[:1]), ("pixels",))):
        meshed = fitting.fit(image, g, scene, devices=devices)
        for name, value in alone.coefficients.items():
            np.testing.assert_allclose(meshed.coefficients[name], value, rtol=10 * tolerance)


@pytest.mark.parametrize(
    "devices",
    [
        lambda one: [],
        lambda one: [one, one],
        lambda one: Mesh(np.array([[one]]), ("rows", "columns")),
    ],
)
def test_devices_that_cannot_be(devices: Callable[[jax.Device], Any]) -> None:
    g = ds.gbuffer(ds.Sphere(), ds.OrthographicCamera(8, 8, 2.2))
    scene = ds.Scene(lights=ds.ParallelLight((0, 0, 1)))
    with pytest.raises(BadInput, match="devices is"):
        fitting.fit(np.ones((8, 8)), g, scene, devices=devices(jax.devices()[0]))


@pytest.mark.slow
def test_two_processes_are_one(capture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def fitted(*options: str) -> dict[str, Any]:
        assert run(["fit", str(capture), "--json", "--precision", "64", *options]) == 0
        return json.loads(capsys.readouterr().out)

    alone, shared = fitted(), fitted("--processes", "2", "--patience", "300")
    assert shared.keys() == alone.keys()
    for key in ("coefficients", "standard_errors", "relative_residual", "per_image"):
        a, b = (np.array(_numbers(document[key])) for document in (alone, shared))
        np.testing.assert_allclose(b, a, rtol=1e-9, atol=1e-12)


@pytest.mark.slow
def test_a_process_that_is_killed(
    capture: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    killed: list[float] = []

    def listen(process: int, worker: subprocess.Popen[str], events: Queue[Any]) -> None:
        for line in worker.stdout or ():
            events.put((process, json.loads(line)))
            if process == 1:  # it has joined, and compiles
                worker.kill()
                killed.append(monotonic())
        events.put((process, {"ended": worker.wait()}))

    monkeypatch.setattr(processes, "_listen", listen)
    assert run(["fit", str(capture), "--processes", "2", "--patience", "300"]) == LOST
    assert monotonic() - killed[0] < SLACK
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith("diffshade: process 2 of 2 was ended by SIGKILL")
    assert output.err.count("\n") == 1


@pytest.mark.slow
def test_a_machine_that_goes_away(
    capture: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    patience = 40
    words = ["--coordinator", Team.local(2, 1).coordinator, "--patience", str(patience)]
    fit = ["fit", str(capture), *words]
    command = [sys.executable, "-m", "diffshade", *fit, "--process", "2/2"]
    gone: list[float] = []
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as other:

        def listen(process: int, worker: subprocess.Popen[str], events: Queue[Any]) -> None:
            for line in worker.stdout or ():
                events.put((process, json.loads(line)))
                if not gone:
                    other.kill()  # and its worker ends with it
                    gone.append(monotonic())
            events.put((process, {"ended": worker.wait()}))

        monkeypatch.setattr(processes, "_listen", listen)
        try:
            status = run([*fit, "--process", "1/2"])
        finally:
            other.kill()
    error = capsys.readouterr().err
    assert status == LOST, error
    assert monotonic() - gone[0] < patience + SLACK
    assert error.startswith("diffshade: process 1 of 2")
    assert error.count("\n") == 1


def test_a_process_that_never_comes(capture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    started, words = monotonic(), ["--coordinator", Team.local(2, 1).coordinator, "--patience", "2"]
    assert run(["fit", str(capture), "--process", "1/2", *words]) == LOST
    assert 2 <= monotonic() - started < SLACK
    output = capsys.readouterr()
    assert output.out == ""
    assert "not all 2 processes came to 127.0.0.1:" in output.err
    assert "within 2 s" in output.err
    assert output.err.count("\n") == 1


@pytest.mark.slow
def test_bad_input_is_told_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    absent = tmp_path / "absent.lp"
    assert run(["fit", str(absent), "--processes", "2", "--patience", "300"]) == 3
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "absent.lp" in error


@pytest.mark.parametrize(
    "words",
    [
        "--processes 0",
        "--processes 2 --process 1/2",
        "--process 1/2",
        "--process 3/2 --coordinator here:5000",
        "--process 1/2 --coordinator here",
        "--process 1/2 --coordinator here:0",
        "--processes 2 --patience 0",
        "--processes 2 --shard 1/2",
        "--processes 2 another",
    ],
)
def test_a_team_that_cannot_be(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["fit", "x", *words.split()]) == 2
    assert capsys.readouterr().err


def test_a_team_of_several_machines() -> None:
    assert team_of(None, None, None, 60.0) is None
    assert team_of(None, (2, 4), "10.0.0.1:5000", 60.0) == Team(4, (1,), "10.0.0.1:5000", 60.0)


def _numbers(value: Any) -> list[float]:
    """All numbers of a document, in order."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        return [number for entry in value for number in _numbers(entry)]
    return [float(value)] if isinstance(value, (int, float)) else []
