# SPDX-License-Identifier: Apache-2.0
"""Puts compiled kernels into a wheel, where ODDSMAP_COMPILE_KERNELS=1 asks for it.

Such a wheel is for one version of Python and one platform, and used as it is by one version of
Numba on processors that have what `SHIPPED_CPU` names; elsewhere kernels are compiled as they are
without it. Any other wheel is for all, and takes no time to build.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

__all__ = ["CompiledKernels"]

_HERE = Path(__file__).parent
_ASKED = os.environ.get("ODDSMAP_COMPILE_KERNELS", "") not in ("", "0")


# Where hatchling is not installed, its class has no type.
class CompiledKernels(BuildHookInterface[Any]):  # type: ignore[misc, unused-ignore]
    """Compiles kernels by running what needs them."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """What runs the toy jobs, besides what builds."""
        if not _ASKED:
            return []
        project = tomllib.loads((_HERE.parent / "pyproject.toml").read_text(encoding="utf-8"))
        needed: list[str] = project["project"]["dependencies"]
        return needed

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the compiled kernels to the files of the wheel, and say whom it is for."""
        if not _ASKED or version == "editable":
            return
        machine = platform.machine()
        if sys.platform != "linux" or machine not in ("x86_64", "aarch64"):
            raise RuntimeError(
                f"ODDSMAP_COMPILE_KERNELS: kernels are shipped for Linux on x86_64 and aarch64, "
                f"this is {sys.platform} on {machine}; build without it"
            )
        # Until `finalize`: the files are read when this returns.
        self._folder = tempfile.TemporaryDirectory()
        sys.path.insert(0, str(Path(self.root) / "src"))
        from oddsmap.kernels.stored_code import SHIPPED, SHIPPED_CPU

        folder = Path(self._folder.name)
        for file in compiled(Path(self.root) / "src", folder, *SHIPPED_CPU[machine]):
            build_data["force_include"][str(file)] = f"oddsmap/kernels/{SHIPPED}/{file.name}"
        python = f"cp{sys.version_info.major}{sys.version_info.minor}"
        build_data["pure_python"] = False
        # No library is linked: what the kernels call is found by Numba, in the running process.
        build_data["tag"] = f"{python}-{python}-manylinux_2_17_{machine}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the compiled kernels, which are in the wheel now."""
        if folder := getattr(self, "_folder", None):
            folder.cleanup()


def compiled(source: Path, folder: Path, cpu: str, features: str) -> list[Path]:
    """Compile all kernels into a folder, for one kind of processor."""
    environment = {key: word for key, word in os.environ.items() if not key.startswith("NUMBA_")}
    environment |= {
        "NUMBA_CACHE_DIR": str(folder),
        "NUMBA_CPU_NAME": cpu,
        "NUMBA_CPU_FEATURES": features,
        "NUMBA_DISABLE_INTEL_SVML": "1",  # a library that not everyone has
        "PYTHONPATH": os.pathsep.join([str(source), os.environ.get("PYTHONPATH", "")]),
    }
    subprocess.run([sys.executable, str(_HERE / "workload.py")], env=environment, check=True)
    files = sorted(folder.rglob("*.code"))
    if not files:
        raise RuntimeError("ODDSMAP_COMPILE_KERNELS: this Numba leaves no compiled kernels")
    return files
