"""Estimator for several touches where images are fine: a lower bound on the loss, by congruent contacts.

See :mod:`benchmarks.bayes_error.congruent` for the bound. It is compared with the sensor on the same touches, and with
the loss of the same ideal reader if it multiplies its posteriors of single touches.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.data.dataset import TouchSet, read_split
from activetouch.sensor import TactileSensor
from belief.observation_model.selection import log_posteriors
from belief.table import Table
from benchmarks.bayes_error.congruent import CongruentContacts
from benchmarks.bayes_error.evidence import Evidence, log_posterior
from benchmarks.bayes_error.findings import Findings, by_touches, chunks, log_loss, mean_of_objects, words
from benchmarks.several_touches import first_round, in_random_orders
from experiments.command_line.arguments import Count
from experiments.parallel import run_tasks
from experiments.sensor.scores import read_touches

Floats = NDArray[np.float64]
_OBJECTS_PER_TASK = 8


@dataclass(frozen=True)
class CongruentBound:
    """Lower bound on the loss of any reader, from contacts that look the same on several shapes."""

    orders: Count = 6
    """Random orders of the poses of each object, those of benchmarks/several_touches.py. Intervals are over objects."""

    def measure(self, sensor: TactileSensor, data: Path, touches: tuple[int, ...], seed: int, jobs: int) -> Findings:
        """The bound, and the loss of the sensor, on the same touches.

        Args:
            sensor: to compare, in its scene.
            data: collection of touches in every pose, whose test objects are used.
            touches: numbers of touches of one object, ascending.
            seed: of orders and intervals.
            jobs: processes; the results do not depend on it.

        Raises:
            UnknownLikelihood: the scene is not one for this bound.
            CorruptFile: there is no such collection, or it is damaged.
        """
        scene, contacts = sensor.scene, CongruentContacts(sensor.scene)
        test = first_round(read_split(data, "test"), len(scene.poses))
        read = in_random_orders(read_touches(sensor.reader, test, f"{data}, test touches"), test, self.orders, seed)
        truth = test.shapes[:: len(scene.poses)]
        shapes, objects = np.tile(truth, self.orders), np.tile(np.arange(len(truth)), self.orders)
        flat = np.flatnonzero(np.isin(truth, list(contacts.shapes)))
        orders = read.poses[:, : touches[-1]].reshape(self.orders, len(truth), -1).swapaxes(0, 1)
        posterior = np.zeros((self.orders, len(truth), touches[-1], 3))
        tasks = [
            partial(_logs_of_interest, contacts, test, flat[some], orders[flat[some]], some)
            for some in chunks(len(flat), _OBJECTS_PER_TASK)
        ]
        for some, found in run_tasks(tasks, jobs, "congruent contacts"):
            posterior[:, flat[some]] = found.swapaxes(0, 1)
        after = posterior[:, :, np.array(touches) - 1].reshape(len(shapes), len(touches), 3)
        true, likeliest, true_if_independent = np.moveaxis(after, 2, 0)
        bound, independent = (np.maximum(-logs, 0.0) for logs in (true, true_if_independent))  # without rounding errors
        known = np.stack([log_posteriors(sensor.model, read.first(n)) for n in touches], axis=1)
        loss = np.stack([log_loss(logs, shapes) for logs in np.moveaxis(known, 1, 0)], axis=1)
        measured = {
            "bound": bound,
            "independent": independent,
            "sensor": loss,
            "excess": loss - bound,
            "accuracy_bound": np.exp(likeliest),
            "sensor_accuracy": known.argmax(axis=2) == shapes[:, None],
        }
        numbers: dict[str, Any] = {
            "estimator": "congruent contacts",
            "objects": len(truth),
            "orders": self.orders,
            "touches": touches,
            "flat_faced": [scene.shape_labels[k] for k in contacts.shapes],
            **{name: [mean_of_objects(some, objects, seed) for some in values.T] for name, values in measured.items()},
            "by_shape": {
                scene.shape_labels[k]: {
                    name: values[shapes == k].mean(axis=0).tolist()
                    for name, values in (("bound", bound), ("sensor", loss))
                }
                for k in contacts.shapes
            },
        }
        return Findings("Least loss of any reader of several touches", _sentences(numbers), _tables(numbers), numbers)


def _logs_of_interest(
    contacts: CongruentContacts, test: TouchSet, objects: NDArray[np.int64], orders: NDArray[np.int64], some: range
) -> tuple[range, Floats]:
    """The objects' places, and log posteriors after 1 to T touches in each of O orders, ``(S, O, T, 3)``.

    They are those of the true and of the likeliest shape, and that of the true one if touches are taken as independent.
    """
    found, num_poses, flat = np.empty((*orders.shape, 3)), len(contacts.scene.poses), list(contacts.shapes)
    for place, row in enumerate((objects * num_poses).tolist()):
        shape, rest, size = int(test.shapes[row]), test.rests[row], float(test.sizes[row])
        touched, true = slice(row, row + num_poses), flat.index(shape)
        offsets, forces = test.offsets[touched], test.forces[touched]
        posterior = partial(contacts.log_posteriors, shape, rest, size)
        single = [posterior(poses, offsets[poses], forces[poses])[0] for poses in np.arange(num_poses)[:, None]]
        logs = np.stack([posterior(order, offsets[order], forces[order]) for order in orders[place]])
        evidence = Evidence(logs, np.stack([single] * len(logs)))
        independent = log_posterior(evidence.independent(orders[place]))
        found[place] = np.stack([logs[..., true], logs.max(axis=2), independent[..., true]], axis=2)
    return some, found


def _sentences(numbers: dict[str, Any]) -> list[str]:
    last = {name: words(numbers[name][-1]) for name in ("bound", "sensor")}
    return [
        f"Contacts of {', '.join(numbers['flat_faced'])} can be congruent: then only the place of the contact tells "
        "the shapes apart, which the offset of the press blurs. The bound is the loss of Bayes' rule for a reader who "
        "is told the images without noise, forces and gains, and whether the shape is one of these; and, while all "
        "touches show one direction of faces only, the orientation up to the 24 rotations of a cube. For all other "
        "shapes its loss is taken as zero. A real reader knows less, so its expected loss is larger.",
        f"{numbers['objects']} unseen objects, their poses in {numbers['orders']} random orders. After "
        f"{numbers['touches'][-1]} touches the bound is {last['bound']} nats, the sensor has {last['sensor']}.",
        "The same reader can also take touches as independent given the shape, and multiply its posteriors of single "
        "touches. The ratio of both losses tells what an ideal reader gains by knowing that touches are of one body.",
    ]


def _tables(numbers: dict[str, Any]) -> list[Table]:
    def columns(**names: str) -> dict[str, list[str]]:
        return {heading.replace("_", " "): [words(entry) for entry in numbers[name]] for heading, name in names.items()}

    touches = numbers["touches"]
    by_shape = [
        (label, name, *(f"{value:.3f}" for value in values))
        for label, entry in numbers["by_shape"].items()
        for name, values in entry.items()
    ]
    pairs = zip(numbers["bound"], numbers["independent"], strict=True)
    ratios = [f"{one['value'] / other['value']:.2f}" if other["value"] else "" for one, other in pairs]
    heads = [f"{n} touch{'es' * (n > 1)}" for n in touches]
    return [
        by_touches("NLL of the shape [nats]", touches, columns(no_reader_below="bound", sensor="sensor")),
        by_touches(
            "NLL of the ideal reader [nats]",
            touches,
            columns(one_body="bound", independent="independent") | {"ratio": ratios},
        ),
        by_touches("NLL of the sensor minus the bound [nats]", touches, columns(difference="excess")),
        by_touches("Accuracy", touches, columns(no_reader_above="accuracy_bound", sensor="sensor_accuracy")),
        Table("NLL by shape [nats]", ("shape", "of", *heads), by_shape),
    ]
