"""One parser under fire, in this process: `python -m fuzz.one_parser PARSER CASES SEED KEEP FOLDER`.

Started by `fuzz.parsers`. The last line on standard error that begins with "counts" says how many inputs
were read and how many refused.
"""

import os
import sys
import traceback
from pathlib import Path

import numpy as np
from fuzz.mutate import LARGEST, mutated
from fuzz.parsers import GUIDED, MEGABYTES, SECONDS

__all__ = ["main"]


def main() -> None:
    """Fuzz; does not return where atheris does it."""
    parser, cases, seed, keep, folder = sys.argv[1:]
    (guided if GUIDED else unguided)(parser, int(cases), int(seed), Path(keep), Path(folder))


def guided(parser: str, cases: int, seed: int, keep: Path, folder: Path) -> None:
    """By atheris: libFuzzer, with the coverage of the parsers' own code, and our damage beside its."""
    import atheris

    with atheris.instrument_imports(include=["diffshade.io", "trimesh.exchange", "tomllib"]):
        from fuzz.target import targets
    target = next(t for t in targets(folder / "files") if t.format.name == parser)
    corpus = folder / "corpus"
    corpus.mkdir()
    seeds = list(target.seeds(folder / "seeds"))
    for number, content in enumerate(seeds):
        (corpus / str(number)).write_bytes(content)
    counts = {True: 0, False: 0}

    def one(content: bytes) -> None:
        counts[target.attempt(content)] += 1
        if sum(counts.values()) % 1000 == 0 or sum(counts.values()) >= cases:
            print("counts", counts[True], counts[False], file=sys.stderr, flush=True)

    def damage(content: bytes, size: int, seed: int) -> bytes:
        if seed % 2:
            return bytes(atheris.Mutate(content, size))
        return mutated(content, seeds, np.random.default_rng(seed))[:size]

    options = {
        "runs": cases,
        "seed": seed,
        "max_len": LARGEST,
        "timeout": SECONDS,
        "rss_limit_mb": MEGABYTES,
        "artifact_prefix": f"{keep / parser.replace(', ', '-')}-",
        "verbosity": 0,
    }
    words = [f"-{name}={value}" for name, value in options.items()]
    atheris.Setup([sys.argv[0], *words, str(corpus)], one, custom_mutator=damage)
    atheris.Fuzz()


def unguided(parser: str, cases: int, seed: int, keep: Path, folder: Path) -> None:
    """By the seeds, and then by random damage to them alone."""
    from fuzz.target import targets

    target = next(t for t in targets(folder / "files") if t.format.name == parser)
    seeds = list(target.seeds(folder / "seeds"))
    rng = np.random.default_rng(seed)
    counts = {True: 0, False: 0}
    for number in range(cases):
        if number < len(seeds):
            content = seeds[number]
        else:
            content = mutated(seeds[int(rng.integers(len(seeds)))], seeds, rng)
        # Kept while it is tried: a crash of the process leaves it behind.
        kept = keep / f"{parser.replace(', ', '-')}-crash-{os.getpid()}"
        kept.write_bytes(content)
        try:
            counts[target.attempt(content)] += 1
        except Exception:
            traceback.print_exc()
            break
        kept.unlink()
    print("counts", counts[True], counts[False], file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
