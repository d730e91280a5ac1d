"""The command line: options and exit status. No command is imported before it runs.

Exit status: 0 done; 1 ran but did not converge; 2 wrong usage; 3 bad input, with one line on standard
error that names the file, what is wrong and what to do; 69 a process of several was lost; 70 an error
of this program; 130 and 141 interrupted, or its reader gone.
"""

import os
import sys
import traceback
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from tyro.conf import DisallowNone, FlagCreatePairsOff, Positional, arg

from diffshade.commands.console import WrongUsage, note
from diffshade.commands.options import (
    parse_circle,
    parse_coordinator,
    parse_encoding,
    parse_hold,
    parse_share,
    parse_white,
)
from diffshade.commands.processes import team_of
from diffshade.commands.settings import Bits, cache_programs, floats_of
from diffshade.errors import BadInput

__all__ = ["main", "run"]

CaptureArgument = Annotated[Positional[Path], arg(metavar="CAPTURE")]
CapturesArgument = Annotated[Positional[tuple[Path, ...]], arg(metavar="CAPTURE ...")]
ShareOption = Annotated[str | None, arg(metavar="I/N", help_behavior_hint="")]
CountOption = Annotated[int | None, arg(metavar="N", help_behavior_hint="")]
AddressOption = Annotated[str | None, arg(metavar="HOST:PORT", help_behavior_hint="")]
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
        out: Write pictures, report.html, report.txt and fit.json into this folder.
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
    captures: CapturesArgument,
    *,
    out: FolderOption = None,
    model: Model = "phong",
    json: Flag = False,
    white: WhiteOption = None,
    circle: CircleOption = None,
    encoding: EncodingOption = None,
    hold: HoldOption = (),
    robust: Flag = False,
    censor: Flag = False,
    gains: Flag = False,
    certify: Flag = False,
    precision: PrecisionOption = None,
    shard: ShareOption = None,
    processes: CountOption = None,
    process: ShareOption = None,
    coordinator: AddressOption = None,
    patience: Annotated[float, arg(metavar="SECONDS")] = 60.0,
) -> int:
    """Recover a material's coefficients and their standard errors from photographs.

    Args:
        captures: A folder in the photometric-stereo layout, an RTI .lp file, or a capture.toml. Of
            several, each is fitted on its own, into a folder of its name below --out.
        out: Write pictures, report.html, report.txt and fit.json into this folder.
        model: Diffuse and ambient terms with this lobe; lambert has none, phong2 two highlights.
        json: Print one JSON object and nothing else on standard output.
        white: The level at which the sensor clips, as a part of full scale.
        circle: The outline of the ball, in pixels from the image's top left corner.
        encoding: How values relate to light, whatever the files say.
        hold: Keep coefficients at a value, one number or one a channel: ka, kd, specular.ks,
            specular.shininess (of one of two lobes: specular.0.ks).
        robust: Take the weight from outliers, such as shadows (Tukey's biweight).
        censor: Use clipped pixels as what they say, "at least", in place of leaving them out.
        gains: Find the strength of each image's lights too.
        certify: Prove that the minimum is global where one shininess is all that is searched, and
            draw the residual over the shininess in report.html.
        precision: Bits of a float; by default as JAX is set: 32, or 64 with JAX_ENABLE_X64.
        shard: Of several captures, fit every N-th from the I-th on.
        processes: Make one fit by so many processes on this machine.
        process: Make one fit by N processes, of which this is the I-th; start the others likewise, on
            other machines. Each needs the capture, and the first writes --out.
        coordinator: Where the first of these processes is reached by the others.
        patience: How long to wait for a process that does not come, or shows no life (status 69).
    """
    options: dict[str, Any] = {
        "as_json": json,
        "model": model,
        "hold": tuple(map(parse_hold, hold)),
        "robust": robust,
        "censor": censor,
        "gains": gains,
        "certify": certify,
        "white": parse_white(white),
        "circle": parse_circle(circle),
        "encoding": parse_encoding(encoding),
    }
    share = parse_share("--shard", shard)
    if not captures:
        raise WrongUsage("no CAPTURE is given: name one or more")
    team = team_of(
        processes, parse_share("--process", process), parse_coordinator(coordinator), patience
    )
    if team is not None:
        if len(captures) > 1 or share is not None:
            raise WrongUsage(
                "--processes and --process make one fit together: give one CAPTURE, or else --shard"
            )
        from diffshade.commands.processes import fit_together

        out_name = None if out is None else str(out)
        return fit_together(
            team, {"path": str(captures[0]), "out": out_name, "precision": precision, **options}
        )
    with floats_of(precision):
        if len(captures) > 1 or share is not None:
            from diffshade.commands.batch import fit_batch

            return fit_batch(captures, shard=share or (1, 1), out=out, **options)
        from diffshade.commands.fit import fit as command

        return command(captures[0], out=out, **options)


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
