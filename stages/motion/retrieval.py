"""Selection of pairs of photos by appearance: visual words, clustered from the photos themselves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pycolmap

from stages.motion.sfm_settings import RetrievalSettings

SIFT_VALUES, EMBEDDED_BITS = 128, 64  # of COLMAP's descriptors and its index


def similar_pairs(
    database: Path, how: RetrievalSettings, scratch: Path, threads: int, seed: int
) -> list[tuple[int, int]]:
    """List pairs i < j (indices) of photos that look alike: of each photo those with most words in common.

    Parameters
    ----------
    database : Path
        With features under working names; is only read.
    how : RetrievalSettings
    scratch : Path
        Folder for the vocabulary.
    threads : int
        The result does not depend on it.
    seed : int
        Start of COLMAP's random generator.
    """
    pycolmap.set_random_seed(seed)
    vocabulary = _vocabulary(database, how, scratch / "vocabulary.bin")
    options = pycolmap.VocabTreePairingOptions(
        num_images=how.neighbours + 1,  # the most similar photo is the photo itself
        max_num_features=how.indexed_features,
        vocab_tree_path=vocabulary,
        num_threads=threads,
    )
    with pycolmap.Database.open(database) as opened:
        found = pycolmap.VocabTreePairGenerator(options, opened).all_pairs()
    return sorted({(min(pair) - 1, max(pair) - 1) for pair in found if pair[0] != pair[1]})


def _vocabulary(database: Path, how: RetrievalSettings, path: Path) -> Path:
    """Cluster a sample of all photos' descriptors into visual words, and write them.

    On one thread: on several, clusters differ from run to run.
    """
    sampled = []
    with pycolmap.Database.open(database) as opened:
        step = max(1, opened.num_descriptors() // (how.words * how.features_per_word))
        for image in opened.read_all_images():
            sampled.append(opened.read_descriptors(image.image_id).data[::step].astype(np.float32))
    rows = np.concatenate(sampled)
    build = pycolmap.VisualIndex.BuildOptions(
        num_visual_words=max(1, min(how.words, len(rows) // how.features_per_word)),
        num_iterations=how.iterations,
        num_rounds=1,
        num_threads=1,
    )
    index = pycolmap.VisualIndex.create(SIFT_VALUES, EMBEDDED_BITS)
    index.build(build, pycolmap.FeatureDescriptorsFloat(type=pycolmap.FeatureExtractorType.SIFT, data=rows))
    index.write(path)
    return path
