"""Descriptors become words, and images with the same words score alike."""

import numpy as np
import pytest

from robotctl.config.robot_file import config_directory
from robotctl.errors import ConfigError, InvalidValue
from robotctl.estimation.places.visual.bits import differing_bits
from robotctl.estimation.places.visual.index import InvertedIndex
from robotctl.estimation.places.visual.matching import MOST_BITS, RATIO, match
from robotctl.estimation.places.visual.training import train
from robotctl.estimation.places.visual.vocabulary import Vocabulary
from robotctl.maps.vocabulary_file import load_vocabulary, save_vocabulary, shipped_vocabulary


def drawn(rng, n):
    return rng.integers(0, 2**64, (n, 4), dtype=np.uint64)


def noisy(rng, descriptors, bits):
    """Turn over some bits of each descriptor."""
    flat = np.unpackbits(descriptors.view(np.uint8), axis=1)
    for row in flat:
        row[rng.choice(256, bits, replace=False)] ^= 1
    return np.packbits(flat, axis=1).view(np.uint64)


def hamming(a, b):
    return np.bitwise_count(a[:, None] ^ b[None]).sum(axis=2)


@pytest.fixture(scope="module")
def trained():
    rng = np.random.default_rng(1)
    corners = drawn(rng, 60)
    images = [noisy(rng, corners[rng.permutation(60)[:40]], 20) for _ in range(12)]
    return corners, images, train(images, np.random.default_rng(0))


def test_bits_are_counted_as_numpy_does():
    rng = np.random.default_rng(0)
    a, b = drawn(rng, 50), drawn(rng, 50)
    found = [differing_bits(x, y) for x, y in zip(a, b, strict=True)]
    assert found == np.bitwise_count(a ^ b).sum(axis=1).tolist()


def test_words_are_where_a_walk_down_the_tree_ends(trained):
    _, images, vocabulary = trained
    leaves = np.cumsum(np.diff(vocabulary.first) == 0) - 1
    words, groups = vocabulary.words_of(images[0])
    for descriptor, word, group in zip(images[0], words, groups, strict=True):
        node, way = 0, []
        while vocabulary.first[node] < vocabulary.first[node + 1]:
            children = np.arange(vocabulary.first[node], vocabulary.first[node + 1])
            node = children[np.argmin(hamming(descriptor[None], vocabulary.centres[children])[0])]
            way.append(node)
        assert (word, group) == (leaves[node], way[0])


def test_sights_of_one_corner_share_words_and_others_do_not(trained):
    corners, _, vocabulary = trained
    rng = np.random.default_rng(2)
    first, _ = vocabulary.words_of(noisy(rng, corners, 10))
    second, _ = vocabulary.words_of(noisy(rng, corners, 10))
    others, _ = vocabulary.words_of(drawn(rng, 60))
    assert np.mean(first == second) > 0.1
    assert np.mean(first == others) < 0.02


def test_training_is_the_same_with_the_same_seed(trained):
    _, images, vocabulary = trained
    again = train(images, np.random.default_rng(0))
    assert np.array_equal(again.centres, vocabulary.centres)
    assert not np.array_equal(train(images, np.random.default_rng(1)).centres, vocabulary.centres)


def test_progress_ends_with_all_done(trained):
    told = []
    train(trained[1], np.random.default_rng(0), lambda done, total: told.append((done, total)))
    assert told == sorted(told)
    assert told[-1][0] == told[-1][1]


def test_a_word_in_every_image_says_nothing(trained):
    _, images, vocabulary = trained
    found = [np.unique(vocabulary.words_of(each)[0]) for each in images]
    counts = np.bincount(np.concatenate(found), minlength=vocabulary.words)
    assert vocabulary.idf == pytest.approx(np.log(len(images) / counts))


def test_too_few_features_are_no_vocabulary():
    with pytest.raises(InvalidValue, match="100 features or more, found 7"):
        train([drawn(np.random.default_rng(0), 7)], np.random.default_rng(0))


def test_scores_are_those_of_dense_bags():
    rng = np.random.default_rng(3)
    bags = rng.random((40, 300)) * (rng.random((40, 300)) < 0.2)
    bags /= bags.sum(axis=1, keepdims=True)
    index = InvertedIndex(300)
    for bag in bags[:-1]:
        index.add(np.flatnonzero(bag), bag[bag > 0])
    scores = index.scores(np.flatnonzero(bags[-1]), bags[-1][bags[-1] > 0])
    assert scores == pytest.approx(1.0 - 0.5 * np.abs(bags[:-1] - bags[-1]).sum(axis=1))


def test_matches_are_those_of_a_comparison_of_all():
    rng = np.random.default_rng(4)
    a = drawn(rng, 80)
    b = noisy(rng, a[rng.permutation(80)[:50]], 30)
    groups = np.sort(rng.integers(0, 2, 80)), np.sort(rng.integers(0, 2, 50))
    bits = hamming(a, b) + 10_000 * (groups[0][:, None] != groups[1])
    nearest = np.argmin(bits, axis=1)
    least, second = np.sort(bits, axis=1)[:, :2].T
    expected = {
        (i, nearest[i])
        for i in np.flatnonzero((least <= MOST_BITS) & (least < RATIO * np.minimum(second, 256)))
        if least[i] == bits[:, nearest[i]].min()
    }
    assert set(map(tuple, match(a, groups[0], b, groups[1]).tolist())) == expected
    assert len(expected) > 10


def test_a_file_gives_the_vocabulary_back(trained, tmp_path):
    vocabulary = trained[2]
    save_vocabulary(vocabulary, tmp_path / "words.npz")
    again = load_vocabulary(tmp_path / "words.npz")
    assert np.array_equal(again.first, vocabulary.first)
    assert np.array_equal(again.words_of(trained[1][0])[0], vocabulary.words_of(trained[1][0])[0])
    (tmp_path / "cut.npz").write_bytes((tmp_path / "words.npz").read_bytes()[:1000])
    with pytest.raises(ConfigError, match=r"cut.npz: no vocabulary"):
        load_vocabulary(tmp_path / "cut.npz")
    np.savez(tmp_path / "loop.npz", centres=vocabulary.centres, first=vocabulary.first[::-1], idf=1)
    with pytest.raises(ConfigError, match=r"loop.npz: no vocabulary"):
        load_vocabulary(tmp_path / "loop.npz")


def test_a_tree_must_be_one(trained):
    vocabulary = trained[2]
    with pytest.raises(InvalidValue, match="idf must be"):
        Vocabulary(vocabulary.centres, vocabulary.first, vocabulary.idf[:-1])


def test_the_shipped_vocabulary_is_small_and_whole():
    assert shipped_vocabulary().parent == config_directory() / "places"
    assert shipped_vocabulary().stat().st_size < 2e6
    assert load_vocabulary(shipped_vocabulary()).words > 5000
