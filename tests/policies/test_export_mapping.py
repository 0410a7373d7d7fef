"""Joint mapping and export: units, refusals that say what to measure, all or nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from scipy.spatial.transform import Rotation

from mam_envs.robots import robot_spec
from mam_pipeline.errors import ConfigError, HintNeeded, MamSimError
from mam_policies.algorithms import algorithm
from mam_policies.lerobot.export import MAPPING, deployment, export_run
from mam_policies.lerobot.joint_mapping import identity, load_mapping, template
from mam_policies.lerobot.policy import Converter, quaternion
from mam_policies.lerobot.robot_interface import mapping_of
from mam_policies.mlp import MlpPolicy
from mam_policies.run import EnvChoice, RunInfo
from mam_sim.cli import main

SO = robot_spec("so100")
JOINTS = [*SO.arm, SO.gripper[0]]


def _filled(file: Path) -> Path:
    data = yaml.safe_load(template("so100", SO.arm, SO.gripper[0]))
    for k, name in enumerate(SO.arm):
        data["joints"][name] |= {"sign": (-1) ** k, "offset": 0.1 * k}
    data["joints"]["gripper"] |= {"closed": -1.1, "open": 0.9}
    file.write_text(yaml.safe_dump(data))
    return file


def test_degrees_and_percent_by_hand(tmp_path: Path) -> None:
    mapping = load_mapping(_filled(tmp_path / "m.yaml"), JOINTS)
    sim = mapping.to_sim(JOINTS, np.array([90.0, 90.0, 0.0, 0.0, 0.0, 25.0]))
    assert np.allclose(sim, [np.pi / 2, 0.1 - np.pi / 2, 0.2, 0.3, 0.4, -0.6])
    assert mapping.names(JOINTS)[0] == "shoulder_pan.pos" and mapping.robot == "so101_follower"


def test_real_and_back_and_through_a_file(tmp_path: Path) -> None:
    mapping = load_mapping(_filled(tmp_path / "m.yaml"), JOINTS)
    real = np.random.default_rng(0).uniform(-80, 80, (7, 6))
    assert np.allclose(mapping.to_real(JOINTS, mapping.to_sim(JOINTS, real)), real)
    mapping.save(tmp_path / "again.yaml")
    again = load_mapping(tmp_path / "again.yaml", JOINTS)
    assert np.allclose(again.to_sim(JOINTS, real), mapping.to_sim(JOINTS, real))


def test_identity_changes_nothing() -> None:
    mapping = identity("panda", {"a": "radians", "b": "metres"})
    assert np.array_equal(mapping.to_sim(["b", "a"], np.array([0.2, 1.0])), [0.2, 1.0])


def test_template_is_refused_until_it_is_filled_in(tmp_path: Path) -> None:
    file = tmp_path / "m.yaml"
    file.write_text(template("so100", SO.arm, SO.gripper[0]))
    with pytest.raises(HintNeeded, match=r"shoulder_pan\.sign.*gripper\.open"):
        load_mapping(file, JOINTS)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sign": 2}, "1 or -1"),
        ({"unit": "gradians"}, "did you mean"),
        ({"sim": "another"}, "which motor is shoulder_pan"),
    ],
)
def test_wrong_entries_are_named(tmp_path: Path, change: dict, words: str) -> None:
    file = _filled(tmp_path / "m.yaml")
    data = yaml.safe_load(file.read_text())
    data["joints"]["shoulder_pan"] |= change
    file.write_text(yaml.safe_dump(data))
    with pytest.raises(ConfigError, match=words):
        load_mapping(file, JOINTS)


def _so_run(folder: Path, algo: str = "bc") -> Path:
    folder.mkdir()
    rows: list[tuple[str, int, int, bool]] = [("agent/qpos", 0, 6, False)]
    RunInfo(algo, EnvChoice(("nowhere",), robot="so100"), rows, 6, 5).save(folder)
    MlpPolicy(6, 6, 5, hidden=(4,)).save(folder)
    return folder


@pytest.mark.parametrize("algo", ["bc_rgb", "bc", "ppo", "sac", "act", "diffusion", "smolvla"])
def test_an_algorithm_is_exported_as_itself_or_refused(tmp_path: Path, algo: str) -> None:
    """Weights of a state network lie in each of these runs; only to some are they the policy."""
    run, learned = _so_run(tmp_path / "run", algo), algorithm(algo)
    whole = algo in ("bc", "ppo", "sac")
    if whole:
        assert learned.network(run).action_dim == 6
    else:
        with pytest.raises(ConfigError, match=f"a run of {algo}, which acts by more than one"):
            learned.network(run)
        # of LeRobot's own, what is exported is their folder policy/, of which nothing lies here
        words = "acts by more than one" if algo == "bc_rgb" else "holds no"
        with pytest.raises(MamSimError, match=words):
            export_run(run, tmp_path / "out", _filled(tmp_path / "m.yaml"))
        assert not (tmp_path / "out").exists()


def test_real_arm_without_mapping_gets_a_template(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    run, out = _so_run(tmp_path / "run"), tmp_path / "out"
    assert main(["export", str(run), "--to", "lerobot", "--out", str(out)]) == 3
    assert "sign and offset of every joint" in capsys.readouterr().err
    assert {p.name for p in out.iterdir()} == {MAPPING}
    with pytest.raises(HintNeeded, match="still needs"):
        export_run(run, out, out / MAPPING)


def test_foreign_folder_is_left_alone(tmp_path: Path) -> None:
    run, out = _so_run(tmp_path / "run"), tmp_path / "out"
    out.mkdir()
    (out / "thesis.txt").write_text("years of work")
    with pytest.raises(ConfigError, match="not empty"):
        export_run(run, out, _filled(tmp_path / "m.yaml"))
    assert (out / "thesis.txt").exists()


def test_quaternions_are_those_of_the_simulator() -> None:
    from mani_skill.utils.geometry.rotation_conversions import matrix_to_quaternion

    m = Rotation.random(50, random_state=1).as_matrix()
    assert np.allclose(quaternion(m), matrix_to_quaternion(torch.as_tensor(m)).numpy(), atol=1e-9)


def test_the_hand_is_turned_as_the_simulator_has_it_also_where_w_changes_its_sign(
    drawer: Path,
) -> None:
    env = EnvChoice((str(drawer),)).make()
    base = env.unwrapped
    rows = [("extra/tcp_pose", 0, 7, False)]
    info = RunInfo("bc", EnvChoice((str(drawer),)), rows, 8, 7)
    converter = Converter(deployment(base, info, mapping_of(base, None)), None)  # type: ignore[arg-type]
    rng, negative = np.random.default_rng(0), 0
    for _ in range(40):
        q = base.agent.robot.get_qpos().clone()
        rest = torch.as_tensor(base.robot_spec.rest_arm + rng.normal(0, 0.3, 7), dtype=q.dtype)
        q[0, base._arm_index] = rest
        base.agent.robot.set_qpos(q)
        simulated = base.tool_pose().raw_pose[0].numpy()
        state = np.concatenate([q[0].numpy(), np.zeros(5)])[None]
        assert np.allclose(converter.observe(state)[1][0], simulated, atol=1e-5)
        negative += simulated[3] < 0
    env.close()
    assert 5 < negative < 35  # both signs were met
