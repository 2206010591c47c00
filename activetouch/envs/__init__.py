"""The search as Gymnasium environments; importing activetouch registers them.

    import activetouch, gymnasium                                        # or name the module in the id:
    env = gymnasium.make("activetouch:activetouch/ObjectTest-v0", scene="coarse", target="cone")

Gymnasium 1.0 did away with plugins, so an installed package cannot register anything before it is imported. What needs
torch or MuJoCo is loaded when an environment is made.
"""

from gymnasium.envs.registration import register, registry

IDS = {
    "activetouch/ObjectTest-v0": "activetouch.envs.object_test:ObjectTestEnv",
    "activetouch/ObjectSearch-v0": "activetouch.envs.object_search:ObjectSearchEnv",
}
"""The environments by id, and where they are."""

for _id, _entry_point in IDS.items():
    if _id not in registry:  # a reload registers nothing twice
        register(_id, _entry_point)

__all__ = ["IDS"]
