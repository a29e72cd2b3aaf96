"""Builds the package with maturin, once it is known that Rust is there.

Without it, or with one that is too old, maturin ends in the middle of a build with words of its own, or downloads a Rust that does not fit.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import maturin
from maturin import build_sdist, get_requires_for_build_sdist, prepare_metadata_for_build_editable  # noqa: F401
from maturin import prepare_metadata_for_build_wheel  # noqa: F401

OLDEST = (1, 95)
"""As ``rust-version`` in the workspace's Cargo.toml."""
WHERE = "https://rustup.rs installs it; a wheel that was built before (maturin build --release) needs none"


def get_requires_for_build_wheel(config_settings: Any = None) -> list[str]:
    _check_rust()
    return maturin.get_requires_for_build_wheel(config_settings)


def get_requires_for_build_editable(config_settings: Any = None) -> list[str]:
    _check_rust()
    return maturin.get_requires_for_build_editable(config_settings)


def build_wheel(directory: str, config_settings: Any = None, metadata_directory: str | None = None) -> str:
    _check_rust()
    return maturin.build_wheel(directory, config_settings, metadata_directory)


def build_editable(directory: str, config_settings: Any = None, metadata_directory: str | None = None) -> str:
    _check_rust()
    return maturin.build_editable(directory, config_settings, metadata_directory)


def _check_rust() -> None:
    expected = ".".join(map(str, OLDEST))
    if shutil.which("cargo") is None:
        raise SystemExit(f"ftac: found no cargo on the path, expected Rust {expected} or later: {WHERE}")
    # In the package's folder: a file of the checkout may choose the toolchain.
    here = Path(__file__).resolve().parent
    said = subprocess.run(["cargo", "--version"], cwd=here, env=os.environ, capture_output=True, text=True)
    found = re.search(r"(\d+)\.(\d+)", said.stdout)
    if said.returncode != 0 or found is None:
        words = (said.stderr or said.stdout).strip()
        raise SystemExit(f"ftac: `cargo --version` ended with {said.returncode} ({words}), expected Rust {expected} or later: {WHERE}")
    if tuple(map(int, found.groups())) < OLDEST:
        raise SystemExit(f"ftac: found {said.stdout.strip()}, expected Rust {expected} or later: {WHERE}")
