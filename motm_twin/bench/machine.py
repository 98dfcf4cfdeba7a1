"""What the numbers were taken on."""

import platform
from pathlib import Path

import joblib


def machine() -> str:
    """Processor, number of cores and Python, for the table's caption."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        lines = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        model = lines[0].split(":", 1)[1].strip() if lines else model
    return f"{model}, {joblib.cpu_count()} cores, {platform.system()}, Python {platform.python_version()}"
