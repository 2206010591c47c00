"""Gymnasium environments of the search; importing activetouch registers them.

    env = gymnasium.make("activetouch:activetouch/ObjectTest-v0", scene="coarse", target="cone")

The prefix ``activetouch:`` imports the package. Making an environment loads MuJoCo. Without Gymnasium (the extra
``rl``), nothing is registered.
"""

from importlib.util import find_spec
from typing import Any

_TEST = "activetouch.envs.object_test:ObjectTestEnv"
IDS: dict[str, tuple[str, dict[str, Any]]] = {
    "activetouch/ObjectTest-v0": (_TEST, {}),
    "activetouch/ObjectTestGoal-v0": (_TEST, {"target": None}),
    "activetouch/ObjectSearch-v0": ("activetouch.envs.object_search:ObjectSearchEnv", {}),
}
"""The entry points of the environments by id, and the arguments that differ from the defaults."""
BANK_ID = "activetouch/ObjectTestBank-v0"
"""The first on recorded touches, for ``gymnasium.make_vec`` alone: many at once, as array operations."""
TRAY_ID = "activetouch/TraySearch-v0"
"""A search among objects in a tray, whose actions are places."""
MOST_STEPS = 1000
"""``max_episode_steps`` of all environments. An episode ends by its own touch limit, far earlier by default."""

if find_spec("gymnasium") is not None:
    from gymnasium.envs.registration import register, registry

    for _id, (_entry_point, _settings) in IDS.items():
        if _id not in registry:  # also if the module is reloaded
            register(_id, _entry_point, max_episode_steps=MOST_STEPS, kwargs=_settings)
    if TRAY_ID not in registry:
        register(TRAY_ID, "activetouch.envs.tray:TraySearchEnv", max_episode_steps=MOST_STEPS)
    if BANK_ID not in registry:
        register(BANK_ID, vector_entry_point="activetouch.envs.batched_episodes:recorded_tests")

__all__ = ["BANK_ID", "IDS", "MOST_STEPS", "TRAY_ID"]
