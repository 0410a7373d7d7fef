"""Objects of other sources than the procedural world that are learned from, as folders of URDFs."""

from __future__ import annotations

from pathlib import Path

OTHERS = (
    Path("../shared/bench/dev"),
    Path("build/sweet_home"),  # benchmarks/sweet_home_dataset.py
    Path("build/scene_synthesizer"),  # benchmarks/scene_synthesizer_dataset.py
)
