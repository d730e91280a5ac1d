"""No file is executed, and no name reaches a shell: what could is not in the source."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = sorted((*ROOT.glob("diffshade/**/*.py"), *ROOT.glob("fitting/**/*.py")))
MODULES = {"pickle", "marshal", "shelve", "dill", "joblib", "cloudpickle", "yaml", "code", "runpy"}
FUNCTIONS = {
    "eval",
    "exec",
    "compile",
    "__import__",
    "system",
    "popen",
    "getoutput",
    "getstatusoutput",
}


def dangers(source: str) -> Iterator[str]:
    """What in a source could run what a file says."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names]
            yield from (name for name in names if name.split(".")[0] in MODULES)
        if not isinstance(node, ast.Call):
            continue
        name = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
        owner = getattr(getattr(node.func, "value", None), "id", "")
        if name in FUNCTIONS and owner != "re":
            yield name
        options = {k.arg: getattr(k.value, "value", None) for k in node.keywords}
        if options.get("shell") or options.get("allow_pickle"):
            yield "shell or allow_pickle"
        if (owner, name) == ("np", "load") and options.get("allow_pickle") is not False:
            yield "np.load that leaves allow_pickle to its default"


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.relative_to(ROOT).as_posix())
def test_no_file_is_executed(file: Path) -> None:
    assert list(dangers(file.read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize(
    "source",
    [
        "import pickle",
        "from yaml import load",
        "eval(x)",
        "os.system(x)",
        "subprocess.run(x, shell=True)",
        "np.load(x)",
        "np.load(x, allow_pickle=True)",
    ],
)
def test_dangers_are_seen(source: str) -> None:
    assert list(dangers(source))
