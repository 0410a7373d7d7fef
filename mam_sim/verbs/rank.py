"""`mam-sim rank`: assets x joints x (lint, check, expert, policy), over anybody's URDF."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tyro.conf import Positional

from mam_pipeline import folders
from mam_pipeline.claims import RANK, claim_folder, not_a_link
from mam_pipeline.edited import Count, Positive
from mam_pipeline.errors import ConfigError, InputError
from mam_pipeline.folders import Scratch
from mam_sim.console import Screen, counting_bar
from mam_sim.options import Verb

if TYPE_CHECKING:
    from mam_sim.rank.measure import Measure, Row, Total, Verdict
    from mam_sim.rank.run import Try


@dataclass(frozen=True, kw_only=True)
class Rank(Verb):
    """Measure whether robots succeed on assets, joint by joint, with Wilson 95 % intervals.

    A URDF, MJCF or USD file of anybody's is taken as it is. What cannot be run is said, and
    counts as failed.
    """

    assets: Positional[tuple[Path, ...]]
    """Asset folders, as `mend` writes them too, folders that hold some, such as a batch's, or URDF,
    MJCF or USD files."""
    robots: str = "panda"
    """Names of arms, with commas between them."""
    task: str | None = None
    """What to do with every joint: open, close, turn_to, push, press, take_out, put_in or a
    plug-in's; joints that it is not for do not count. By default what each joint suggests."""
    episodes: Count = 5
    """Of every joint and robot."""
    policy: Literal["none", "bc"] = "none"
    """Train and test this policy on every joint too; takes minutes each."""
    truth: tuple[Path, ...] = ()
    """URDFs of the true objects, one per asset in the same order, standing as the files did that
    the assets were made from, or with Z up where those have Y up. They are simulated in the assets'
    place: what an asset claims is planned with, and what the true object can do counts."""
    jobs: Count = 1
    """Rows at once, each in a process of its own."""
    out: Path | None = None
    """Folder for rank.json, index.html and every row; what it holds is not measured again."""
    video: bool = False
    """Film the first episodes of every row, for the page (needs --out and a Vulkan driver)."""
    time_limit: Positive = 1800.0
    """Seconds after which a row is given up."""
    memory_limit: Positive = 8.0
    """Gigabytes of memory at which a row is given up."""
    json: bool = False
    """Print the result as JSON instead of tables."""

    def run(self) -> int:
        """Measure what is not measured yet; print the tables.

        Returns:
            0, or 2 where none of the assets can be read.
        """
        from mam_pipeline.optional import require
        from mam_sim.rank.run import subjects

        names, assets = self._robots(), subjects(self.assets)
        if self.truth and len(self.truth) != len(assets):
            raise ConfigError(
                f"--truth needs one URDF per asset: {len(assets)}, not {len(self.truth)}"
            )
        require("rank", "sapien", "mani_skill", "torch", "gymnasium")
        from mam_envs.robots import ROBOTS
        from mam_envs.tasks import TASKS

        for name in names:
            ROBOTS.check(name)
        if self.task is not None:
            TASKS.check(self.task)
        if self.out is None:
            with Scratch() as folder:
                return self._measure(assets, Path(folder).resolve(), names, Screen(self.quiet))
        claim_folder(self.out, RANK)
        for part in ("verdicts", "rows", "videos", "foreign", "made", "runs", "truth"):
            not_a_link(self.out / part)
        return self._measure(assets, self.out.resolve(), names, Screen(self.quiet))

    def _robots(self) -> list[str]:
        names = list(dict.fromkeys(n.strip() for n in self.robots.split(",") if n.strip()))
        if not self.assets:
            raise ConfigError("name at least one asset folder or URDF")
        if not names:
            raise ConfigError("--robots needs at least one name")
        if self.video and self.out is None:
            raise ConfigError("--video needs --out DIR: where the videos stay")
        return names

    def _measure(
        self, assets: Sequence[Path], out: Path, robots: Sequence[str], screen: Screen
    ) -> int:
        from mam_pipeline.guarded import Limits
        from mam_sim.rank.measure import VERSION, Measure, total
        from mam_sim.rank.page import as_json, rows_table, totals_table
        from mam_sim.rank.run import Subject, attempts, examine, joints_of_truth, measured

        real = [joints_of_truth(path) for path in self.truth]
        faults = [Subject.of(path).fault for path in assets]
        if all(faults):
            raise InputError(faults[0])
        if self.out is not None and not (out / RANK.file).exists():  # whose folder it is from now
            out.mkdir(parents=True, exist_ok=True)
            folders.write_text(out / RANK.file, json.dumps({"measure": {"version": VERSION}}))
        limits = Limits(self.time_limit, self.memory_limit)
        measure = Measure(episodes=self.episodes, task=self.task)
        with counting_bar(screen, len(assets), 0) as tell:
            verdicts = examine(assets, out, self.jobs, limits, lambda w: tell(w, "check"))
        tasks = attempts(
            assets, verdicts, robots, measure, self.policy, out, limits, self.video,
            self.truth,
        )  # fmt: skip
        with counting_bar(screen, len(tasks), sum(t.done for t in tasks)) as tell:
            rows = measured(tasks, self.jobs, lambda w: tell(w, "expert"))
        true = {v.name: joints for v, joints in zip(verdicts, real)} if real else None
        totals = [total(verdicts, rows, robot, self.episodes, true) for robot in robots]
        data = as_json(verdicts, rows, totals, measure)
        data["truth"] = [folders.as_text(str(path)) for path in self.truth]
        if self.out is not None:
            self._save(out, data, verdicts, rows, totals, tasks, measure)
        status = 0 if any(v.folder for v in verdicts) else 2
        if self.json:
            screen.json(data)
            return status
        screen.out.width = max(screen.out.width, 140)  # the table must not lose digits in a pipe
        screen.table(rows_table(verdicts, rows))
        screen.table(totals_table(totals))
        if self.out is not None:
            screen.say(f"page: {self.out / 'index.html'}")
            screen.say("next: open the page in any browser; every failure says why")
        return status

    def _save(
        self, out: Path, data: object, verdicts: Sequence[Verdict], rows: Sequence[Row],
        totals: Sequence[Total], tasks: Sequence[Try], measure: Measure,
    ) -> None:  # fmt: skip
        from mam_sim.rank.page import page

        videos = {(t.verdict.name, t.joint, t.robot): f"videos/{t.film.name}"
                  for t in tasks if t.film.is_file()}  # fmt: skip
        folders.write_text(out / RANK.file, json.dumps(data, indent=1) + "\n")
        text = page(verdicts, rows, totals, measure, videos)
        folders.write_text(out / "index.html", text)
