"""Long specifications of deciders are shortened where space is short, and what is left out is said."""

import pytest

from experiments.search.short_names import short_names

SHARED = "confirm=0.98,reject=0.02,max_touches=20"


@pytest.mark.parametrize(
    ("names", "short", "said"),
    [
        (["threshold", "point_based"], ["threshold", "point_based"], []),
        (
            [f"random_poses({SHARED})", f"information_gain({SHARED})"],
            ["random_poses", "information_gain"],
            ["All have the settings confirm=0.98, reject=0.02, max_touches=20."],
        ),
        (
            ["random_poses(confirm=0.9)", "information_gain(confirm=0.98)"],
            ["random_poses(confirm=0.9)", "information_gain(confirm=0.98)"],
            [],
        ),
        (
            ["own_decider:EveryPose(confirm=0.9)", "information_gain"],
            ["own_decider:EveryPose", "information_gain"],
            ["own_decider:EveryPose has the settings confirm=0.9."],
        ),
        (["threshold(high=0.9)"], ["threshold"], ["It has the settings high=0.9."]),
        (["threshold", "threshold(high=0.9)"], ["threshold", "threshold(high=0.9)"], []),
        (
            ["threshold", "sb3:runs/a-folder-with-a-long-name/policy.zip"],
            ["threshold", "sb3 2"],
            ["sb3 2 is sb3:runs/a-folder-with-a-long-name/policy.zip."],
        ),
    ],
)
def test_names_are_short_different_and_what_is_left_out_is_said(names, short, said):
    found, told = short_names(names)
    assert list(found) == names
    assert list(found.values()) == short
    assert told == said
