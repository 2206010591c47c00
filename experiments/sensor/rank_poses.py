"""``activetouch rank-poses``: the best fixed order of poses, found on calibration objects."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from activetouch.data.dataset import read_split
from belief.claims import claim_folder, ends_claims
from belief.observation_model.rigid_body import joint_model
from experiments.command_line.arguments import BadArgument, Count, check_arguments
from experiments.scene_choice import SceneChoice, repeats_folder
from experiments.sensor.scores import read_touches
from experiments.sensor_choice import open_collection, open_sensor, require_collection, sensor_folder
from planners.pose_order import hypothesis_order, write_order


@dataclass(frozen=True)
class RankPoses:
    """Find the best fixed order of poses for the decider best_order, and put it into the sensor's folder.

    The order is greedy: each pose is the one with which the touches so far leave the lowest negative log likelihood of
    the shape, over the objects of the calibration split. The printed likelihoods are of the same objects, to which the
    sensor's temperature was fitted too: they rank poses, and are lower than on other objects.

    For example:

        activetouch rank-poses --scene keyed
        activetouch rank-poses --scene coarse --poses directions26 --data data/coarse-26 --sensor runs/sensor-coarse-26
    """

    scene: str = "keyed"
    """Name of the scene, which gives the defaults of the next two."""
    poses: str | None = None
    """Set of poses, if not the scene's own: mix or directions26."""
    data: Path | None = None
    """Folder of the collection; data/SCENE-repeats by default."""
    sensor: Path | None = None
    """Folder of the sensor, or name of a shipped one; that of the scene by default."""
    objects: Count = 120
    """Calibration objects to rank by."""
    length: Count = 16
    """Poses in the order; the others follow as the scene has them."""

    @ends_claims
    def run(self) -> None:
        """Rank, print and write."""
        check_arguments(self)
        choice = SceneChoice(self.scene, poses=self.poses)
        sensor = open_sensor(self.sensor, choice)
        model = joint_model(sensor.model)
        if model is None:
            raise BadArgument(f"--sensor must have a joint observation model to rank by, got {sensor.model.name!r}")
        data = self.data if self.data is not None else repeats_folder(self.scene)
        manifest = open_collection(data, self.scene, repeats=True)
        require_collection(data, manifest, sensor.reader.card, None, repeats=True)
        folder = sensor_folder(self.sensor, self.scene)
        claim_folder(folder)
        touches = read_split(data, "calibration")
        number = len(sensor.scene.poses)
        in_round = np.arange(len(touches.poses)) % manifest.touches_per_object < number  # the first round of poses
        touches = touches.select(in_round & (touches.object_ids < self.objects))
        read = read_touches(sensor.reader, touches, "reading calibration touches")
        assert read.features is not None, "a joint model has a reader with embeddings"
        ratios = np.empty((number, len(touches.poses) // number, len(model.shape_labels), model.num_hypotheses), "f4")
        for pose in range(number):
            ratios[pose] = model.scores(pose, read.features[0][touches.poses == pose])
        print("NLL of the shape on the objects by which the poses are ranked [nats]")
        order, losses = hypothesis_order(ratios, touches.shapes[::number], min(self.length, number))
        labels = [sensor.scene.pose_labels[pose] for pose in order]
        for place, (label, loss) in enumerate(zip(labels, losses, strict=True), 1):
            print(f"{place:2d}  {label:<12}  NLL after it {loss:.4f}")
        write_order(folder, labels, losses)
        print(f"wrote the order into {folder}")
