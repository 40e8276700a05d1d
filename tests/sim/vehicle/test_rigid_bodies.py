"""Choice of the rigid-body engine."""

import gc
import sys

import pytest

from sim.vehicle import rigid_bodies
from sim.vehicle.rigid_bodies import choose_physics
from survey.core.errors import ConfigError


@pytest.fixture
def installed(monkeypatch):
    def only(*modules):
        monkeypatch.setattr(rigid_bodies, "find_spec", lambda name: name if name in modules else None)

    return only


def test_contact_takes_bullet_and_else_mujoco(installed):
    installed("pybullet", "mujoco")
    assert choose_physics("contact") == "bullet"
    assert choose_physics("mujoco") == "mujoco"
    installed("mujoco")
    assert choose_physics("contact") == "mujoco"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("contact", "is 'contact', and neither pybullet nor mujoco is installed; install mujoco, or set"),
        ("bullet", "is 'bullet', and pybullet is not installed; install pybullet, or set"),
    ],
)
def test_an_engine_that_is_not_installed_is_refused_in_one_sentence(installed, name, message):
    installed()
    with pytest.raises(ConfigError, match=message):
        choose_physics(name)


def test_a_missing_bullet_ends_in_one_error_and_no_recursion(monkeypatch):
    from sim.vehicle.rigid_bodies import BulletClient

    monkeypatch.setitem(sys.modules, "pybullet", None)
    unraised = []
    monkeypatch.setattr(sys, "unraisablehook", unraised.append)
    with pytest.raises(ConfigError, match="pybullet is not installed"):
        BulletClient()
    gc.collect()
    assert not unraised
