"""``python -m ftac.lerobot export|demonstrations``: runs the function of this name with the arguments on stdin (JSON), and prints what it returns as JSON."""

from __future__ import annotations

import json
import sys
from typing import Any

from ftac.lerobot import demonstrations, export


def main() -> None:
    """Called by the program ``ftac``."""
    (name,) = sys.argv[1:]
    functions: dict[str, Any] = {"export": export, "demonstrations": demonstrations}
    try:
        print(json.dumps(functions[name](**json.load(sys.stdin))))
    except KeyboardInterrupt:
        sys.exit(130)
    except (ImportError, OSError, RuntimeError, ValueError) as error:
        sys.exit(f"ftac: {error}")


if __name__ == "__main__":
    main()
