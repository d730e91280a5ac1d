"""The command line: options and exit status. No command is imported before it runs.

Exit status: 0 done; 1 ran but did not converge; 2 wrong usage; 3 bad input, with one line on standard
error that names the file, what is wrong and what to do; 70 an error of this program; 130 and 141
interrupted, or its reader gone.
"""

import os
import sys
import traceback
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.conf import DisallowNone, FlagCreatePairsOff, Positional, arg

from diffshade.commands.console import WrongUsage, note
from diffshade.commands.options import parse_circle, parse_encoding, parse_hold, parse_white
from diffshade.commands.settings import Bits, cache_programs, floats_of
from diffshade.errors import BadInput

__all__ = ["main", "run"]

CaptureArgument = Annotated[Positional[Path], arg(metavar="CAPTURE")]
FolderOption = Annotated[Path | None, arg(metavar="DIR", help_behavior_hint="")]
Flag = Annotated[FlagCreatePairsOff[bool], arg(help_behavior_hint="")]
PrecisionOption = Annotated[Bits | None, arg(help_behavior_hint="")]
WhiteOption = Annotated[str | None, arg(metavar="LEVEL", help_behavior_hint="")]
CircleOption = Annotated[str | None, arg(metavar="CX,CY,R", help_behavior_hint="")]
EncodingOption = Annotated[str | None, arg(metavar="linear|srgb|GAMMA", help_behavior_hint="")]
HoldOption = Annotated[tuple[str, ...], arg(metavar="NAME=VALUE ...", help_behavior_hint="")]
Model = Literal["phong", "blinn-phong", "lambert", "phong2"]


def main() -> int:
    """The program `diffshade`; returns its exit status."""
    cache_programs()
    warnings.showwarning = lambda message, *_, **__: note(f"warning: {message}")
    try:
        return run(sys.argv[1:])
    except KeyboardInterrupt:
        return 130
    except (
        BrokenPipeError
    ):  # who read the output has gone; nor can Python's own last flush reach it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except Exception:
        traceback.print_exc()
        return 70


def run(arguments: Sequence[str]) -> int:
    """One command in this process, whose settings stay as they are; returns the exit status."""
    try:
        return tyro.extras.subcommand_cli_from_dict(
            {"demo": demo, "render": render, "fit": fit, "evaluate": evaluate},
            prog="diffshade",
            description="Shading under known lights, and materials from photographs.",
            args=arguments,
            config=(DisallowNone,),
        )
    except SystemExit as stop:  # tyro: 0 after help, 2 after wrong usage
        return stop.code if isinstance(stop.code, int) else 2
    except WrongUsage as error:
        note(f"{error}")
        return 2
    except BadInput as error:
        note(f"{error}")
        return 3


def demo(*, out: FolderOption = None, json: Flag = False, precision: PrecisionOption = None) -> int:
    """Recover the material of a ball that ships with the package, and compare with the truth.

    Args:
        out: Write pictures, report.txt and fit.json into this folder.
        json: Print one JSON object and nothing else on standard output.
        precision: Bits of a float; by default as JAX is set: 32, or 64 with JAX_ENABLE_X64.
    """
    with floats_of(precision):
        from diffshade.commands.demo import demo as command

        return command(out=out, as_json=json)


def render(
    scene: Annotated[Positional[Path], arg(metavar="SCENE.toml")],
    *,
    out: Annotated[Path, arg(metavar="FILE")],
    precision: PrecisionOption = None,
) -> int:
    """Render a sphere or a mesh under lights.

    Args:
        scene: Geometry, camera, lights and material.
        out: The image: .png (sRGB, 8 bits), .exr or .npy (linear).
        precision: Bits of a float; by default as JAX is set: 32, or 64 with JAX_ENABLE_X64.
    """
    with floats_of(precision):
        from diffshade.commands.render import render as command

        return command(scene, out=out)


def fit(
    capture: CaptureArgument,
    *,
    out: FolderOption = None,
    model: Model = "phong",
    json: Flag = False,
    white: WhiteOption = None,
    circle: CircleOption = None,
    encoding: EncodingOption = None,
    hold: HoldOption = (),
    precision: PrecisionOption = None,
) -> int:
    """Recover a material's coefficients and their standard errors from photographs.

    Args:
        capture: A folder in the photometric-stereo layout, an RTI .lp file, or a capture.toml.
        out: Write pictures, report.txt and fit.json into this folder.
        model: Diffuse and ambient terms with this lobe; lambert has none, phong2 has two.
        json: Print one JSON object and nothing else on standard output.
        white: The level at which the sensor clips, as a part of full scale.
        circle: The outline of the ball, in pixels from the image's top left corner.
        encoding: How values relate to light, whatever the files say.
        hold: Keep coefficients at a value, one number or one a channel: ka, kd, specular.ks,
            specular.shininess (of one of two lobes: specular.0.ks).
        precision: Bits of a float; by default as JAX is set: 32, or 64 with JAX_ENABLE_X64.
    """
    with floats_of(precision):
        from diffshade.commands.fit import fit as command

        return command(
            capture,
            out=out,
            as_json=json,
            model=model,
            hold=tuple(map(parse_hold, hold)),
            white=parse_white(white),
            circle=parse_circle(circle),
            encoding=parse_encoding(encoding),
        )


def evaluate(
    fit: Annotated[Positional[Path], arg(metavar="FIT.json")],
    capture: CaptureArgument,
    *,
    json: Flag = False,
    white: WhiteOption = None,
    circle: CircleOption = None,
    encoding: EncodingOption = None,
    precision: PrecisionOption = None,
) -> int:
    """Measure how well a fitted material predicts photographs.

    Args:
        fit: A fit.json as `fit --out` writes it, or the output of `fit --json`.
        capture: A folder in the photometric-stereo layout, an RTI .lp file, or a capture.toml.
        json: Print one JSON object and nothing else on standard output.
        white: The level at which the sensor clips, as a part of full scale.
        circle: The outline of the ball, in pixels from the image's top left corner.
        encoding: How values relate to light, whatever the files say.
        precision: Bits of a float; by default as JAX is set: 32, or 64 with JAX_ENABLE_X64.
    """
    with floats_of(precision):
        from diffshade.commands.evaluate import evaluate as command

        return command(
            fit,
            capture,
            as_json=json,
            white=parse_white(white),
            circle=parse_circle(circle),
            encoding=parse_encoding(encoding),
        )
