"""The exact belief of the circle-square tasks: it keeps the truth, and looks where the classes differ."""

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from benchmarks.apgym import GLIMPSE, Generator, Player, inform, play


def two_kinds():
    """Images of 9 × 9 pixels, two to a place, which differ in one pixel."""
    rng = np.random.default_rng(0)
    grounds = rng.random((8, 9, 9))
    singles = np.repeat(grounds, 2, axis=0)
    singles[1::2, 8, 8] += 0.5
    return Generator(singles, np.arange(16)[:, None], np.arange(16) % 2, 2)


def shown(generator, image, place):
    """What ap_gym shows of an image around a place (x, y) in [-1, 1]²."""
    axis = np.arange(9) - 4.0
    points = np.meshgrid(
        *(reach * at + np.arange(GLIMPSE) - 2 for reach, at in zip((2, 2), place[::-1], strict=True)), indexing="ij"
    )
    picture = generator.singles[generator.members[image]].max(axis=0)
    glimpse = RegularGridInterpolator((axis, axis), picture)(np.stack(points, axis=-1))
    return {"glimpse": glimpse.astype(np.float32)[..., None], "glimpse_pos": np.asarray(place, np.float32)}


@pytest.mark.parametrize("place", [(-1, -1), (1, 1), (0.0, 0.0), (0.131, -0.77), (-0.999, 1.0)])
def test_only_images_that_show_the_glimpse_remain(place):
    generator, player = two_kinds(), Player(two_kinds(), inform, np.random.default_rng(0))
    player.begin()
    player.see(shown(generator, 5, place))
    assert set(player.images) == ({5} if place == (1, 1) else {4, 5})
    assert player.probs.sum() == pytest.approx(1.0)


def test_it_goes_to_the_pixel_in_which_the_classes_differ_and_an_inverted_label_is_inverted():
    generator, player = two_kinds(), Player(two_kinds(), inform, np.random.default_rng(0))
    player.begin()
    player.see(shown(generator, 5, (0.5, 0.2)) | {"inverted_label": 1})
    way = inform(player)
    assert way @ (0.5, 0.8) / np.linalg.norm(way) / np.hypot(0.5, 0.8) == pytest.approx(1.0)
    player.see(shown(generator, 5, (1, 1)) | {"inverted_label": 2})
    assert player.probs.tolist() == [1.0, 0.0]
    assert not inform(player).any()


def test_the_images_of_two_objects_are_those_of_ap_gym_and_the_truth_is_found():
    pytest.importorskip("ap_gym", reason="needs the extra apgym")
    from ap_gym.envs.image import DoubleCircleSquareDataset

    dataset = DoubleCircleSquareDataset(image_shape=(16, 16))
    generator = Generator.of(dataset)
    assert len(generator.labels) == len(dataset)
    image, label = dataset[12345]
    left = np.arange(len(dataset))
    for row, column in np.ndindex(12, 12):
        left = generator.agreeing(left, image[row : row + 5, column : column + 5, 0], np.array([row, column]) + 2.0)
    assert generator.labels[left].tolist() == [label]  # one image alone, and it has this class
    played = play("CircleSquare-s15-v0", inform, 5, 0)
    assert played.right[:, -1].all()
    assert (played.true_probs > 0).all()
