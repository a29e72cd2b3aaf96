#!/usr/bin/env python3
"""Licences of the packages that are compiled into programs of this workspace, as a text on stdout.

    third_party.py TARGET PACKAGE...    for instance: third_party.py x86_64-unknown-linux-gnu ftac ftac-lab

Each package is listed with its licence; the texts of the licence files that packages bring with them follow, each text
once. Packages must have been downloaded (`cargo fetch --locked`).
"""

import collections
import json
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
LICENCE_FILE = re.compile(r"(licen[cs]e|copying|copyright|notice|unlicense)([-_.].*)?", re.I)


def graph(target):
    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--offline", "--filter-platform", target]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    if done.returncode != 0:
        sys.exit("third_party: cargo metadata failed; `cargo fetch --locked` downloads the packages")
    return json.loads(done.stdout)


def compiled(metadata, names):
    """Ids of the packages of other people that `names` depend on, directly or not, other than for builds and tests."""
    members = set(metadata["workspace_members"])
    nodes = {node["id"]: node for node in metadata["resolve"]["nodes"]}
    begin = {package["name"]: package["id"] for package in metadata["packages"] if package["id"] in members}
    missing = [name for name in names if name not in begin]
    if missing:
        sys.exit(f"third_party: found no package {', '.join(missing)} in the workspace")
    found, todo = set(), [begin[name] for name in names]
    while todo:
        package = todo.pop()
        if package not in found:
            found.add(package)
            normal = (d for d in nodes[package]["deps"] if any(kind["kind"] is None for kind in d["dep_kinds"]))
            todo.extend(dependency["pkg"] for dependency in normal)
    return found - members


def texts(package):
    """Licence files of a package: those of its folder, and the one that its manifest names."""
    folder = pathlib.Path(package["manifest_path"]).parent
    files = {path for path in folder.iterdir() if path.is_file() and LICENCE_FILE.fullmatch(path.name)}
    if package["license_file"]:
        files.add((folder / package["license_file"]).resolve())
    return [path.read_text(encoding="utf-8", errors="replace").strip() for path in sorted(files)]


def main(target, names):
    metadata = graph(target)
    wanted = compiled(metadata, names)
    packages = sorted((p for p in metadata["packages"] if p["id"] in wanted), key=lambda p: (p["name"], p["version"]))
    owners = collections.defaultdict(list)
    print(f"Packages compiled into {' and '.join(names)}, with their licences.\n")
    for package in packages:
        named = f"{package['name']} {package['version']}"
        brought = texts(package)
        if not package["license"] and not brought:
            sys.exit(f"third_party: {named}: found no licence")
        print(f"{named}: {package['license'] or 'see its text below'}")
        for text in brought:
            if named not in owners[text]:
                owners[text].append(named)
    for text, named in owners.items():
        print(f"\n{'=' * 80}\n{', '.join(named)}\n{'-' * 80}\n{text}")


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    main(sys.argv[1], sys.argv[2:])
