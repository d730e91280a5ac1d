"""Scripts that run where the CPU passes for several devices, which a process decides when it starts."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

__all__ = ["printed"]


def printed(script: str, devices: int) -> Any:
    """The JSON that a script prints."""
    environment = {
        **os.environ,
        "XLA_FLAGS": f"--xla_force_host_platform_device_count={devices}",
        "JAX_PLATFORMS": "cpu",
        "PYTHONPATH": str(Path(__file__).parents[1]),
    }
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, timeout=900
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
