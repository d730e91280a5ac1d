"""Bad input: exit status 3, one line on standard error that names the file, nothing left behind."""

from pathlib import Path

import numpy as np
import pytest
from command_line import SIZE, make_capture, program

from diffshade.cli import run
from diffshade.io.image import write_png


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_capture(tmp_path_factory.mktemp("capture"))


def copy(capture: Path, folder: Path) -> Path:
    folder.mkdir()
    for file in (*capture.glob("?.png"), capture / "capture.toml"):
        (folder / file.name).write_bytes(file.read_bytes())
    return folder


def missing_image(folder: Path) -> str:
    (folder / "1.png").unlink()
    return "1.png"


def mismatched_sizes(folder: Path) -> str:
    write_png(folder / "1.png", np.full((SIZE, SIZE + 1, 3), 0.5), bits=16)
    return "1.png"


def another_camera(folder: Path) -> str:
    text = (folder / "capture.toml").read_text()
    (folder / "capture.toml").write_text(text.replace(f"width = {SIZE}", f"width = {SIZE + 1}"))
    return "capture.toml"


def light_count(folder: Path) -> str:
    (folder / "capture.toml").unlink()
    write_png(folder / "mask.png", np.ones((SIZE, SIZE)))
    (folder / "filenames.txt").write_text("0.png\n1.png\n")
    (folder / "light_directions.txt").write_text("0 0 1\n")
    return "light_directions.txt"


def empty_mask(folder: Path) -> str:
    write_png(folder / "mask.png", np.zeros((SIZE, SIZE)))
    (folder / "capture.toml").write_text(
        'mask = "mask.png"\n' + (folder / "capture.toml").read_text()
    )
    return "mask.png"


def nan_in_a_light(folder: Path) -> str:
    text = (folder / "capture.toml").read_text()
    (folder / "capture.toml").write_text(text.replace("intensity = 1.0", "intensity = nan", 1))
    return "capture.toml"


def text_named_png(folder: Path) -> str:
    (folder / "0.png").write_text("this is not a picture\n")
    return "0.png"


def empty_mesh(folder: Path) -> str:
    (folder / "empty.obj").write_text("# nothing\n")
    text = (folder / "capture.toml").read_text()
    sphere = '{ kind = "sphere", center = [0, 0, 0], radius = 1.0 }'
    mesh = '{ kind = "mesh", file = "empty.obj" }'
    (folder / "capture.toml").write_text(text.replace(sphere, mesh))
    return "empty.obj"


def no_point_light_to_attenuate(folder: Path) -> str:
    text = (folder / "capture.toml").read_text().replace("parallel", "point")
    behind = text.replace("direction = [0.4, 0.5, 1.0]", "position = [0, 0, -9]")
    behind = behind.replace("direction = [-0.6, 0.1, 1.0]", "position = [0, 0, -9]")
    asked = behind.replace("1.0 }]", '1.0, attenuation = { kind = "quadratic" } }]')
    (folder / "capture.toml").write_text(asked)
    return folder.name


BAD = [
    missing_image,
    mismatched_sizes,
    another_camera,
    light_count,
    empty_mask,
    nan_in_a_light,
    text_named_png,
    empty_mesh,
    no_point_light_to_attenuate,
]


@pytest.mark.parametrize("spoil", BAD)
def test_bad_input_is_one_line_and_status_3(
    spoil, capture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = copy(capture, tmp_path / "capture")
    culprit = spoil(folder)
    out = tmp_path / "out"
    assert run(["fit", str(folder), "--out", str(out), "--json"]) == 3
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.count("\n") == 1
    assert output.err.startswith("diffshade: ")
    assert culprit in output.err
    assert not out.exists()
    assert not list(tmp_path.glob(".*"))


def test_bad_input_in_a_process_of_its_own(capture: Path, tmp_path: Path) -> None:
    folder = copy(capture, tmp_path / "capture")
    text_named_png(folder)
    done = program("fit", folder, "--out", tmp_path / "out", XDG_CACHE_HOME=str(tmp_path))
    assert done.returncode == 3
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert str(folder / "0.png") in done.stderr
    assert not (tmp_path / "out").exists()


def test_an_out_that_is_a_file_is_refused_before_the_work(
    capture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out").write_text("mine")
    assert run(["fit", str(capture), "--out", str(tmp_path / "out")]) == 3
    assert str(tmp_path / "out") in capsys.readouterr().err
    assert (tmp_path / "out").read_text() == "mine"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("no json", "is not JSON"),
        ("[1]", "holds no JSON object"),
        ("{}", '"schema" is missing'),
        ('{"schema": "diffshade.fit/2"}', "schema is"),
        ('{"schema": "diffshade.fit/1"}', '"coefficients" is missing'),
    ],
)
def test_evaluate_refuses_what_is_no_fit(
    text: str, says: str, capture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "fit.json").write_text(text)
    assert run(["evaluate", str(tmp_path / "fit.json"), str(capture)]) == 3
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "fit.json" in error
    assert says in error
