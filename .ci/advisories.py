#!/usr/bin/env python3
"""Known advisories on Rust packages, kept in the tree for machines that cannot reach the RustSec database.

    advisories.py collect CLONE   facts of a clone of https://github.com/RustSec/advisory-db, as CSV on stdout
    advisories.py lay FOLDER      a git repository in FOLDER that cargo-deny reads as its database

advisories.csv has a row per advisory: id, package, date, kind (vulnerability, unsound, unmaintained, notice), and the
patched and unaffected version requirements, separated by semicolons. Its first line names the day of the clone.
"""

import csv
import json
import pathlib
import re
import subprocess
import sys
import tomllib

TABLE = pathlib.Path(__file__).with_name("advisories.csv")
COLUMNS = ["id", "package", "date", "kind", "patched", "unaffected"]


def collect(clone):
    day = subprocess.run(
        ["git", "-C", clone, "log", "-1", "--format=%cs"], check=True, capture_output=True, text=True
    ).stdout.strip()
    print(f"# facts of the RustSec advisory database as of {day}")
    rows = csv.writer(sys.stdout, lineterminator="\n")
    rows.writerow(COLUMNS)
    names = subprocess.run(
        ["git", "-C", clone, "ls-tree", "-r", "--name-only", "HEAD", "crates/"], check=True, capture_output=True, text=True
    ).stdout.split()
    for name in sorted(names):
        text = subprocess.run(
            ["git", "-C", clone, "show", f"HEAD:{name}"], check=True, capture_output=True, text=True
        ).stdout
        front = re.search(r"```toml\n(.*?)```", text, re.S)
        if not front:
            sys.exit(f"{name}: found no front matter, expected a fenced block of TOML")
        data = tomllib.loads(front.group(1))
        advisory, versions = data["advisory"], data.get("versions", {})
        if "withdrawn" in advisory:
            continue
        kind = advisory.get("informational", "vulnerability")
        lists = ["; ".join(versions.get(key, [])) for key in ("patched", "unaffected")]
        rows.writerow([advisory["id"], advisory["package"], advisory["date"], kind, *lists])


def lay(folder):
    folder = pathlib.Path(folder)
    with TABLE.open(newline="") as file:
        lines = [line for line in file if not line.startswith("#")]
    for row in csv.DictReader(lines):
        requirements = lambda key: json.dumps([part for part in row[key].split("; ") if part])
        informational = "" if row["kind"] == "vulnerability" else f'informational = "{row["kind"]}"\n'
        entry = folder / "crates" / row["package"] / f"{row['id']}.md"
        entry.parent.mkdir(parents=True, exist_ok=True)
        entry.write_text(
            f'```toml\n[advisory]\nid = "{row["id"]}"\npackage = "{row["package"]}"\ndate = "{row["date"]}"\n'
            f"{informational}\n[versions]\npatched = {requirements('patched')}\n"
            f"unaffected = {requirements('unaffected')}\n```\n\n# {row['id']} on {row['package']}\n\n"
            f"See https://rustsec.org/advisories/{row['id']}.html\n"
        )
    git = ["git", "-C", str(folder), "-c", "user.name=ci", "-c", "user.email=ci@localhost"]
    for step in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "advisories"]):
        subprocess.run([*git, *step], check=True)


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[1] not in ("collect", "lay"):
        sys.exit(__doc__)
    {"collect": collect, "lay": lay}[sys.argv[1]](sys.argv[2])
