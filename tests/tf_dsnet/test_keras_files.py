"""Trained networks in Keras's own files give what they give here, to who has TensorFlow alone."""

from __future__ import annotations

import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from bridge import DsnetError
from bridge.exchange.dsnet import Scaling, TrainedDsnet
from dsnet.cli import main
from tf_dsnet.framework import keras, quietly, tf
from tf_dsnet.keras_files import save_keras, stock_network, write_savedmodel, write_tflite
from tf_dsnet.model import named_weights, with_own_names
from tf_dsnet.predictors import DsnetPredictor, applied_dsnet

MOTION = np.random.default_rng(2).normal(1, 1, (40, 79)).astype(np.float32)
ALONE = """
import sys, numpy, keras
network = keras.models.load_model(sys.argv[1])
numpy.save(sys.argv[3], network.predict(numpy.load(sys.argv[2])[None], verbose=0)[0])
sys.exit(bool({"bridge", "dsnet", "tf_dsnet"} & {name.partition(".")[0] for name in sys.modules}))
"""


@pytest.fixture(params=["standardised", "faithful"])
def trained(request, trained_dsnet: TrainedDsnet) -> TrainedDsnet:
    """Weights that are not those of the beginning, on scaled and on raw values."""
    if request.param == "standardised":
        return trained_dsnet
    return TrainedDsnet("dsnet_faithful", trained_dsnet.weights, Scaling.identity())


@pytest.fixture
def saved(trained: TrainedDsnet, tmp_path: Path) -> Path:
    save_keras(stock_network(trained), tmp_path / "network.keras")
    return tmp_path / "network.keras"


def test_a_process_without_this_project_opens_it(trained, saved, tmp_path) -> None:
    np.save(tmp_path / "motion.npy", MOTION)
    files = [saved, tmp_path / "motion.npy", tmp_path / "latents.npy"]
    command = [sys.executable, "-I", "-c", ALONE, *map(str, files)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    np.testing.assert_array_equal(np.load(files[2]), applied_dsnet(trained)(MOTION))


def test_it_has_the_papers_parameters_and_the_same_bytes_each_time(trained, saved, tmp_path):
    network = stock_network(trained)
    assert network.count_params() == 65_140
    save_keras(network, tmp_path / "again.keras")
    assert (tmp_path / "again.keras").read_bytes() == saved.read_bytes()


def test_a_savedmodel_gives_the_same_latents(trained, saved, tmp_path) -> None:
    write_savedmodel(tmp_path / "served", saved)
    network = tf.saved_model.load(tmp_path / "served")
    latents = network.serve(MOTION[None]).numpy()[0]
    np.testing.assert_array_equal(latents, applied_dsnet(trained)(MOTION))


def stepped(path: Path) -> np.ndarray:
    """Latents (T, 100) of a TensorFlow Lite graph, frame by frame."""
    with quietly(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "(?s).*LiteRT", UserWarning)  # what newer TensorFlow says
        runner = tf.lite.Interpreter(str(path)).get_signature_runner()
    shapes = {name: about["shape"] for name, about in runner.get_input_details().items()}
    assert shapes.pop("motion").tolist() == [1, 79]
    states = {name: np.zeros(shape, np.float32) for name, shape in shapes.items()}
    latents = []
    for frame in MOTION:
        states = runner(motion=frame[None], **states)
        latents.append(states.pop("latents")[0])
    return np.array(latents)


def test_a_lite_graph_steps_to_the_same_latents(trained, saved, tmp_path) -> None:
    write_tflite(tmp_path / "step.tflite", saved)
    latents = applied_dsnet(trained)(MOTION)
    atol = 1e-5 * np.abs(latents).max()
    np.testing.assert_allclose(stepped(tmp_path / "step.tflite"), latents, atol=atol)


def of_two_gates(input_size: int) -> keras.Model:
    """A network of one's own: other cells, two of them."""
    keras.utils.set_random_seed(1)
    motion = keras.Input((None, input_size))
    memory = keras.layers.GRU(20, return_sequences=True)(motion)
    memory = keras.layers.LSTM(12, return_sequences=True)(memory)
    return keras.Model(motion, keras.layers.Dense(100)(memory))


def test_networks_of_ones_own_are_stepped_too(trained_dsnet, tmp_path) -> None:
    weights = named_weights(with_own_names(of_two_gates(79)))
    arrays = TrainedDsnet("mine", weights, trained_dsnet.scaling).arrays()
    entry = DsnetPredictor("mine", "Mine", build=of_two_gates)
    save_keras(entry.network(arrays), tmp_path / "mine.keras")
    write_tflite(tmp_path / "mine.tflite", tmp_path / "mine.keras")
    trained = TrainedDsnet.from_arrays("mine", arrays)
    latents = applied_dsnet(trained, of_two_gates)(MOTION)
    atol = 1e-5 * np.abs(latents).max()
    np.testing.assert_allclose(stepped(tmp_path / "mine.tflite"), latents, atol=atol)


def of_neighbours(input_size: int) -> keras.Model:
    motion = keras.Input((None, input_size))
    near = keras.layers.Conv1D(8, 3, padding="causal")(motion)
    return keras.Model(motion, keras.layers.Dense(100)(near))


def of_two_ways(input_size: int) -> keras.Model:
    motion = keras.Input((None, input_size))
    ways = [keras.layers.Dense(100)(motion), keras.layers.Dense(100)(motion)]
    return keras.Model(motion, keras.layers.Add()(ways))


@pytest.mark.parametrize(("build", "why"), [(of_neighbours, "Conv1D"), (of_two_ways, "follow")])
def test_layers_that_one_frame_is_not_enough_for_are_refused(
    build, why, trained_dsnet, tmp_path
) -> None:
    weights = named_weights(with_own_names(build(79)))
    trained = TrainedDsnet("mine", weights, trained_dsnet.scaling)
    save_keras(stock_network(trained, build), tmp_path / "mine.keras")
    with pytest.raises(DsnetError, match=rf"'mine', .*{why}.*; expected a chain"):
        write_tflite(tmp_path / "mine.tflite", tmp_path / "mine.keras")
    assert not (tmp_path / "mine.tflite").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--to", "keras", "--out", "n.h5"], "a file whose name ends in .keras"),
        (["--to", "keras", "--out", "n.keras"], "dsnet_plus of the packaged model"),
        (["--to", "tflite", "--out", "n.tflite", "--gain", "2"], "with a motion or its controls"),
        (["--to", "keras", "--out", "n.keras", "--precision", "int8"], "are for --to onnx"),
    ],
)
def test_what_is_no_network_is_refused(options, words, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit):
        main(["export", *options])
    assert words in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
