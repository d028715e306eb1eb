"""A Python environment with pinned packages, in target/<name>; made at the first run, and when the list changes."""

import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]


def python(name, packages):
    environment = ROOT / "target" / name
    interpreter = environment / "bin" / "python"
    wanted = "\n".join(packages)
    made = environment / "packages"
    if not made.exists() or made.read_text() != wanted:
        subprocess.run([sys.executable, "-m", "venv", "--clear", environment], check=True)
        subprocess.run([interpreter, "-m", "pip", "install", "--quiet", *packages], check=True)
        made.write_text(wanted)
    return interpreter
