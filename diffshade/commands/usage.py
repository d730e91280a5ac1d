"""The words that each command takes, and its help. Imports little, so that help is there at once."""

import re
from argparse import SUPPRESS, Action, ArgumentParser, _ActionsContainer
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NoReturn

from diffshade.commands import options
from diffshade.commands.console import WrongUsage

__all__ = ["EXPORTS", "MODELS", "parse"]

CAPTURE = (
    "A folder in the photometric-stereo layout, an RTI .lp, a Relight .dome, AliceVision's lights.json,"
    " or a capture.toml."
)
EXPORTS = ("mtl", "gltf", "threejs", "mitsuba")
MODELS = ("phong", "blinn-phong", "lambert", "phong2", "ggx", "plastic", "plastic2")
FLAGS = {
    "--robust": "Take the weight from outliers, such as shadows (Tukey's biweight).",
    "--censor": 'Use clipped pixels as what they say, "at least", in place of leaving them out.',
    "--fit-gamma": "Find the gamma of photographs whose --encoding is unknown, by the shading itself.",
    "--refine-circle": "Refine the outline of a ball, where the geometry is made of one, by the shading"
    " itself. Of what is refined --out holds the capture too.",
    "--refine-lights": "Refine the direction and the strength of each image's one distant light by the"
    " shading itself, and name the lamp that was moved.",
    "--gains": "Find the strength of each image's lights too.",
    "--certify": "Prove that the minimum is global where one shininess is all that is searched, and"
    " draw the residual over the shininess in report.html.",
}


def parse(arguments: Sequence[str]) -> dict[str, Any]:
    """The name of the `command` and what it takes; `WrongUsage` is raised, and SystemExit after help."""
    program = _Parser(
        prog="diffshade",
        description="Shading under known lights, and materials from photographs.",
    )
    program.add_argument("--version", action=_Version)
    commands = program.add_subparsers(
        title="commands", metavar="COMMAND", dest="command", required=True
    )
    for name, (does, takes) in COMMANDS.items():
        takes(commands.add_parser(name, help=does, description=does))
    # An outline may begin with a minus, which argparse takes for an option unless a space comes first.
    words = [f" {word}" if re.match(r"-[\d.]+,", word) else word for word in arguments]
    found, unknown = program.parse_known_args(words)
    if unknown:
        chosen = commands.choices[found.command]
        close = get_close_matches(unknown[0], chosen.words(), n=1)
        meant = f" (did you mean {close[0]}?)" if close else ""
        chosen.error(f"unknown argument {unknown[0].strip()}{meant}")
    return vars(found)


class _Parser(ArgumentParser):
    """A parser that complains in one line, and knows no abbreviations."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(allow_abbrev=False, **settings)

    def words(self) -> list[str]:
        """The options."""
        return list(self._option_string_actions)

    def error(self, message: str) -> NoReturn:
        raise WrongUsage(f"{message.removeprefix('argument ')}; see {self.prog} --help")


class _Version(Action):
    """Prints the version, which is looked up only then."""

    def __init__(self, option_strings: Sequence[str], dest: str) -> None:
        super().__init__(option_strings, SUPPRESS, nargs=0, help="Print the version.")

    def __call__(self, parser: ArgumentParser, *_: Any) -> NoReturn:
        from importlib.metadata import version

        print(f"diffshade {version('diffshade')}")
        parser.exit()


def _demo(parser: ArgumentParser) -> None:
    _results(parser)
    _precision(parser)


def _render(parser: ArgumentParser) -> None:
    parser.add_argument(
        "path",
        metavar="SCENE.toml",
        type=Path,
        help="Geometry, camera, lights and material.",
    )
    parser.add_argument(
        "--out",
        metavar="FILE",
        type=Path,
        required=True,
        help="The image: .png (sRGB, 8 bits), .exr or .npy (linear).",
    )
    _outside(parser)
    _precision(parser)


def _view(parser: ArgumentParser) -> None:
    parser.add_argument(
        "path",
        metavar="FIT_OR_SCENE",
        type=Path,
        help="A scene.toml, or a fit.json or the folder that `fit --out` wrote, whose material is shown"
        " on a ball.",
    )
    parser.add_argument(
        "--out",
        metavar="FILE",
        type=Path,
        help="The page; by default beside the file, with its name and .html.",
    )
    _outside(parser)
    _precision(parser)


def _fit(parser: ArgumentParser) -> None:
    parser.add_argument(
        "captures",
        metavar="CAPTURE",
        type=Path,
        nargs="+",
        help=f"{CAPTURE} Of several, each is fitted on its own, into a folder of its name below --out.",
    )
    _results(parser)
    _precision(parser)
    _reading(parser)
    model = parser.add_argument_group("what is fitted, and how")
    model.add_argument(
        "--model",
        choices=(*MODELS, "auto"),
        default="phong",
        help="Diffuse and ambient terms with this lobe; lambert has none, phong2 two. ggx has"
        " microfacets; plastic has them over a body that light enters and leaves through the same"
        " boundary, plastic2 in two lobes. auto compares all, and takes the one that the images speak"
        " for most. (default: %(default)s)",
    )
    model.add_argument(
        "--hold",
        metavar="NAME=VALUE",
        type=options.held,
        nargs="+",
        action="extend",
        default=[],
        help="Keep coefficients at a value, one number or one a channel: ka, kd, specular.ks,"
        " specular.shininess (of one of two lobes: specular.0.ks), specular.alpha, body.index.",
    )
    for flag, does in FLAGS.items():
        model.add_argument(flag, action="store_true", help=does)
    shares = parser.add_argument_group("several captures, several processes")
    shares.add_argument(
        "--shard",
        metavar="I/N",
        type=options.share,
        help="Of several captures, fit every N-th from the I-th on.",
    )
    shares.add_argument(
        "--processes",
        metavar="N",
        type=int,
        help="Make one fit by so many processes on this machine.",
    )
    shares.add_argument(
        "--process",
        metavar="I/N",
        type=options.share,
        help="Make one fit by N processes, of which this is the I-th; start the others likewise, on"
        " other machines. Each needs the capture, and the first writes --out.",
    )
    shares.add_argument(
        "--coordinator",
        metavar="HOST:PORT",
        type=options.coordinator,
        help="Where the first of these processes is reached by the others.",
    )
    shares.add_argument(
        "--patience",
        metavar="SECONDS",
        type=float,
        default=60.0,
        help="How long to wait for a process that does not come, or shows no life (status 69)."
        " (default: %(default)g)",
    )


def _evaluate(parser: ArgumentParser) -> None:
    _fit_json(parser)
    parser.add_argument("path", metavar="CAPTURE", type=Path, help=CAPTURE)
    _json(parser)
    _precision(parser)
    _reading(parser)


def _export(parser: ArgumentParser) -> None:
    _fit_json(parser)
    parser.add_argument(
        "--to",
        choices=EXPORTS,
        required=True,
        help="Wavefront's .mtl, glTF 2.0 with KHR_materials_specular (a ball of the material), three.js"
        " MeshPhongMaterial as JSON, or a Mitsuba 3 dictionary as JSON.",
    )
    parser.add_argument(
        "--out", metavar="FILE", type=Path, required=True, help="The file to write."
    )
    parser.add_argument(
        "--irradiance",
        metavar="E",
        type=options.level,
        help="Of gltf, threejs and mitsuba: the irradiance that a light of I_p = 1 has there; by default"
        " pi, of which k_d is the albedo.",
    )
    _json(parser)
    _precision(parser)


def _calibrate(parser: ArgumentParser) -> None:
    parser.add_argument(
        "folder",
        metavar="FOLDER",
        type=Path,
        help="Photographs of a mirror ball from one place, one lamp in each: those that filenames.txt"
        " names, or all but the mask.",
    )
    parser.add_argument(
        "--mask",
        metavar="FILE",
        type=Path,
        help="Where the ball is. Without it and --circle its outline is found in the brightest of all"
        " images.",
    )
    _circle(parser)
    parser.add_argument(
        "--fov",
        metavar="DEGREES",
        type=float,
        help="The vertical field of view of a camera that is near; without it the ball is seen from"
        " afar.",
    )
    parser.add_argument(
        "--out",
        metavar="FILE",
        type=Path,
        help="Write the directions too: .toml, [[image]] tables to end a capture.toml with; .lp, as of an"
        " RTI; .txt, a light_directions.txt.",
    )
    _json(parser)
    _outside(parser)
    _precision(parser)


def _fit_json(parser: ArgumentParser) -> None:
    parser.add_argument(
        "fit_json",
        metavar="FIT.json",
        type=Path,
        help="A fit.json as `fit --out` writes it, its folder, or the output of `fit --json`.",
    )


def _results(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        help="Write pictures, report.html, report.txt and fit.json into this folder.",
    )
    _json(parser)


def _json(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--json",
        dest="as_json",
        action="store_true",
        help="Print one JSON object and nothing else on standard output.",
    )


def _precision(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--precision",
        type=int,
        choices=(32, 64),
        help="Bits of a float; by default as JAX is set: 32, or 64 with JAX_ENABLE_X64.",
    )


def _outside(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--allow-outside",
        action="store_true",
        help="Read files that lie outside the folder of the file that names them, too.",
    )


def _circle(parser: _ActionsContainer) -> None:
    parser.add_argument(
        "--circle",
        metavar="CX,CY,R",
        type=options.circle,
        help="The outline of the ball, in pixels from the image's top left corner.",
    )


def _reading(parser: ArgumentParser) -> None:
    _outside(parser)
    photographs = parser.add_argument_group("what the photographs say")
    photographs.add_argument(
        "--white",
        metavar="LEVEL",
        type=options.level,
        help="The level at which the sensor clips, as a part of full scale.",
    )
    _circle(photographs)
    photographs.add_argument(
        "--encoding",
        metavar="linear|srgb|GAMMA",
        type=options.encoding,
        help="How values relate to light, whatever the files say.",
    )


COMMANDS = {
    "demo": (
        "Recover the material of a ball that ships with the package, and compare with the truth.",
        _demo,
    ),
    "render": ("Render a sphere or a mesh under lights.", _render),
    "view": (
        "Write an HTML page that shows a scene or a fit, with a slider for every coefficient.",
        _view,
    ),
    "fit": (
        "Recover a material's coefficients and their standard errors from photographs.",
        _fit,
    ),
    "evaluate": ("Measure how well a fitted material predicts photographs.", _evaluate),
    "export": (
        "Write a fitted material for another tool, and say how far it is from the fit over angles.",
        _export,
    ),
    "calibrate": ("Find the directions of lights from photographs of a mirror ball.", _calibrate),
}
