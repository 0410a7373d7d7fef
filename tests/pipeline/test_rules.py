"""Every hand rule has a sentence and a switch that reaches the backends."""

from __future__ import annotations

import re

import pytest

from mam_pipeline import backends, config_file
from mam_pipeline.errors import ConfigError
from mam_pipeline.joints.estimate import OF_JOINTS
from mam_pipeline.make_config import EngineConfig
from mam_pipeline.rules import ALL_RULES, Ruled, Rules


def test_every_rule_has_a_sentence_and_is_on() -> None:
    said = re.findall(r"^ {8}(\w+): \((segment|parts|joints)", Rules.__doc__ or "", re.MULTILINE)
    assert tuple(name for name, _ in said) == Rules.names()
    assert all(getattr(ALL_RULES, name) for name in Rules.names())
    assert {name for name, stage in said if stage == "joints"} == set(OF_JOINTS)


@pytest.mark.parametrize(
    ("role", "name"),
    [("segmenter", "geometric"), ("reasoner", "embedded"), ("solver", "embedded"),
     ("solver", "lm")],
)  # fmt: skip
def test_a_switch_reaches_the_backend_and_leaves_the_first_as_it_was(role: str, name: str) -> None:
    backend = backends.load(role, name)[1]
    assert isinstance(backend, Ruled)
    changed = backend.with_rules(ALL_RULES.without("minor"))
    assert type(changed) is type(backend)
    assert not changed.rules.minor and changed.rules.abstain  # type: ignore[attr-defined]
    assert backend.rules == ALL_RULES  # type: ignore[attr-defined]


def test_a_file_turns_a_rule_off_and_a_wrong_name_is_told() -> None:
    config = config_file.fill(EngineConfig(), {"rules": {"completed": False}})
    assert config.rules == ALL_RULES.without("completed")
    with pytest.raises(ConfigError, match=r"did you mean 'rules\.completed'"):
        config_file.fill(EngineConfig(), {"rules": {"complete": False}})
