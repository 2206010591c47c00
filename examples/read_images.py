"""Features, probabilities and label of every image in a folder, as a CSV file (paper §5.7).

Run: python examples/read_images.py --images data/paper-images --out read.csv

The images are PNG files in folders by split and shape, as `activetouch collect --images` writes them. The reader is
that of the shipped sensor `paper-independent`, or, by `--reader runs/train-paper/reader.safetensors`, one that
`activetouch train` wrote; with the backbone `tiny` it has 768 features.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.special import softmax

from activetouch import TactileSensor
from activetouch.perception.reader import TactileReader


def main() -> None:
    """Read the images, and write what the reader makes of them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=Path, required=True, help="folder")
    parser.add_argument("--reader", type=Path, help="file of a reader that activetouch train wrote")
    parser.add_argument("--out", type=Path, default=Path("read.csv"))
    given = parser.parse_args()
    if given.reader is None:
        reader = TactileSensor.shipped("paper-independent").reader
    else:
        reader = TactileReader.load(given.reader)
    files = sorted(given.images.rglob("*.png"))
    if not files:
        raise SystemExit(
            f"{given.images} holds no PNG files; write some with activetouch collect --images {given.images}"
        )
    read = reader.read(np.stack([np.asarray(Image.open(file)) for file in files]))
    labels = np.array(reader.card.shape_labels)
    with given.out.open("w", newline="", encoding="utf-8") as opened:
        writer = csv.writer(opened)
        numbers = [f"feature{index}" for index in range(read.features.shape[1])]
        writer.writerow(["image", "label", *(f"p_{label}" for label in labels), *numbers])
        for file, label, probs, features in zip(
            files, labels[read.labels], softmax(read.logits, axis=1), read.features, strict=True
        ):
            writer.writerow([file.relative_to(given.images), label, *probs.tolist(), *features.tolist()])
    print(f"wrote {given.out}: {len(files)} images, {len(numbers)} features each")


if __name__ == "__main__":
    main()
