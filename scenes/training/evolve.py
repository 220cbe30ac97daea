"""Trains a small neural network for a task by an evolution strategy, and writes it as ONNX.

python scenes/training/evolve.py scenes/car_drive.yaml -o scenes/policies/car_drive.onnx

In each generation a population of networks, the current one with Gaussian noise on its weights, goes through the same
random episodes side by side in `TaskWorlds`. The ranks of their returns say in which direction the weights move
(Salimans et al. 2017, arXiv:1703.03864): no gradients, no replay, nothing but NumPy. The same seed gives the same
network on the same machine. Observations are normalized by their running mean and standard deviation, which the file
holds as part of the first layer. Beside it goes the training curve, as a CSV table.

Needs the package onnx: pip install onnx
"""

import argparse
import csv
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

import mjrun
from mjrun.task.worlds import TaskWorlds

NORMALIZING = 30  # generations after which the statistics of observations stay as they are
LIMIT = 10.0  # standard deviations at which normalized observations are clipped while training
VALIDATION_SEEDS = 1_000_000 + np.arange(64)  # of episodes that no generation trains on


class Network:
    """Dense layers with tanh between them, for many sets of weights at once."""

    def __init__(self, sizes: list[int]) -> None:
        self.layers = list(pairwise(sizes))
        self.count = sum((inputs + 1) * outputs for inputs, outputs in self.layers)

    def initial(self, rng: np.random.Generator) -> np.ndarray:
        """Random weights `(count,)`, whose answers are close to zero."""
        scales = [1 / np.sqrt(inputs) for inputs, _ in self.layers]
        scales[-1] *= 0.01
        parts = [
            np.concatenate([scale * rng.standard_normal(inputs * outputs), np.zeros(outputs)])
            for (inputs, outputs), scale in zip(self.layers, scales, strict=True)
        ]
        return np.concatenate(parts)

    def split(self, weights: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Matrices `(n, inputs, outputs)` and biases `(n, 1, outputs)` of weights `(n, count)`."""
        parts, start = [], 0
        for inputs, outputs in self.layers:
            end = start + inputs * outputs
            matrix = weights[:, start:end].reshape(-1, inputs, outputs)
            parts.append((matrix, weights[:, None, end : end + outputs]))
            start = end + outputs
        return parts

    def act(self, weights: np.ndarray, observations: np.ndarray) -> np.ndarray:
        """The answers `(n, nact)` of weights `(n, count)` to observations `(n, nobs)`."""
        values = observations[:, None, :]
        for index, (matrix, bias) in enumerate(self.split(weights)):
            values = np.tanh(values) if index else values
            values = values @ matrix + bias
        return values[:, 0, :]


class Statistics:
    """The running mean and standard deviation of observations."""

    def __init__(self, size: int) -> None:
        self.count, self.mean, self.squares = 0, np.zeros(size), np.ones(size)

    @property
    def std(self) -> np.ndarray:
        return np.sqrt(np.maximum(self.squares - self.mean**2, 1e-4))

    def add(self, observations: np.ndarray) -> None:
        self.count += len(observations)
        share = len(observations) / self.count
        self.mean = self.mean + share * (observations.mean(axis=0) - self.mean)
        self.squares = self.squares + share * ((observations**2).mean(axis=0) - self.squares)

    def normalized(self, observations: np.ndarray) -> np.ndarray:
        return np.clip((observations - self.mean) / self.std, -LIMIT, LIMIT)


def episodes(
    worlds: TaskWorlds, network: Network, weights: np.ndarray, seeds: np.ndarray, statistics: Statistics
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """An episode in every world: the returns `(n,)`, whether it was a success `(n,)`, and all that was observed."""
    observations = worlds.reset(seeds)
    returns, successes = np.zeros(len(seeds)), np.zeros(len(seeds), bool)
    seen, running = [], np.arange(len(seeds))
    while len(running):
        seen.append(observations)
        actions = network.act(weights[running], statistics.normalized(observations))
        step = worlds.step(actions, running)
        returns[running] += step.rewards
        successes[running] = [ending is not None and ending.kind == "success" for ending in step.ended]
        observations, running = step.observations[~step.over], running[~step.over]
    return returns, successes, np.concatenate(seen)


def evolve(task: mjrun.Task, options: argparse.Namespace) -> tuple[Network, np.ndarray, Statistics, list[list[float]]]:
    """The best network by its validation, and a row of the training curve for each validation."""
    rng = np.random.default_rng(options.seed)
    pairs, repeats = options.population // 2, options.episodes
    worlds, validation = TaskWorlds(task, 2 * pairs * repeats), TaskWorlds(task, len(VALIDATION_SEEDS))
    nobs, nact = len(worlds.observation_names), len(worlds.action_names)
    network, statistics = Network([nobs, *options.hidden, nact]), Statistics(nobs)

    weights = best = network.initial(rng)
    momentum, variance = np.zeros(network.count), np.zeros(network.count)  # of Adam
    curve: list[list[float]] = []
    start = time.perf_counter()
    for generation in range(1, options.generations + 1):
        half = rng.standard_normal((pairs, network.count))
        noise = np.concatenate([half, -half])
        seeds = np.tile(rng.integers(2**31, size=repeats), 2 * pairs)  # the same episodes for all
        population = np.repeat(weights + options.sigma * noise, repeats, axis=0)
        returns, _, seen = episodes(worlds, network, population, seeds, statistics)
        fitness = returns.reshape(-1, repeats).mean(axis=1)

        ranks = np.empty(2 * pairs)
        ranks[np.argsort(fitness)] = np.linspace(-0.5, 0.5, 2 * pairs)
        gradient = ranks @ noise / (2 * pairs * options.sigma)
        momentum = 0.9 * momentum + 0.1 * gradient
        variance = 0.99 * variance + 0.01 * gradient**2
        corrected = momentum / (1 - 0.9**generation) / (np.sqrt(variance / (1 - 0.99**generation)) + 1e-8)
        weights = weights + options.rate * (1 - 0.9 * generation / options.generations) * corrected
        if generation <= NORMALIZING:
            statistics.add(seen)

        if generation % options.validate == 0 or generation == options.generations:
            everywhere = np.tile(weights, (len(VALIDATION_SEEDS), 1))
            scores, successes, _ = episodes(validation, network, everywhere, VALIDATION_SEEDS, statistics)
            row = [generation, fitness.mean(), scores.mean(), successes.mean()]
            if generation >= min(NORMALIZING, options.generations) and row[2] >= max(
                (score for at, _, score, _ in curve if at >= NORMALIZING), default=-np.inf
            ):
                best = weights
            curve.append(row)
            seconds = time.perf_counter() - start
            sys.stderr.write(f"generation {generation}: return {row[2]:.2f}, success {row[3]:.0%}, {seconds:.0f} s\n")
    return network, best, statistics, curve


def save(path: Path, network: Network, weights: np.ndarray, statistics: Statistics) -> None:
    """Writes `obs` (1, nobs) to `actions` (1, nact) in float32, with the normalization in the first layer."""
    layers = [(matrix[0], bias[0, 0]) for matrix, bias in network.split(weights[None])]
    matrix, bias = layers[0]
    layers[0] = (matrix / statistics.std[:, None], bias - (statistics.mean / statistics.std) @ matrix)

    nodes, tensors, last = [], [], "obs"
    for index, (matrix, bias) in enumerate(layers):
        tensors += [
            numpy_helper.from_array(matrix.astype(np.float32), f"matrix_{index}"),
            numpy_helper.from_array(bias.astype(np.float32), f"bias_{index}"),
        ]
        is_last = index == len(layers) - 1
        output = "actions" if is_last else f"sum_{index}"
        nodes.append(helper.make_node("Gemm", [last, f"matrix_{index}", f"bias_{index}"], [output]))
        if not is_last:
            last = f"hidden_{index}"
            nodes.append(helper.make_node("Tanh", [output], [last]))

    nobs, nact = network.layers[0][0], network.layers[-1][1]
    graph = helper.make_graph(
        nodes,
        path.stem,
        [helper.make_tensor_value_info("obs", TensorProto.FLOAT, [1, nobs])],
        [helper.make_tensor_value_info("actions", TensorProto.FLOAT, [1, nact])],
        tensors,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9, producer_name="mjrun")
    onnx.checker.check_model(model)
    path.parent.mkdir(parents=True, exist_ok=True)
    onnx.save(model, path)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("task", help="a task document")
    parser.add_argument("-o", "--output", type=Path, required=True, help="the ONNX file; the curve goes beside it")
    parser.add_argument("--generations", type=int, default=150)
    parser.add_argument("--population", type=int, default=64, help="networks in a generation, half of them mirrored")
    parser.add_argument("--episodes", type=int, default=2, help="episodes of each of them")
    parser.add_argument("--hidden", type=int, nargs="*", default=[16, 16], help="units of the hidden layers")
    parser.add_argument("--sigma", type=float, default=0.1, help="standard deviation of the noise on the weights")
    parser.add_argument("--rate", type=float, default=0.05, help="step of the weights in the first generation")
    parser.add_argument("--validate", type=int, default=10, metavar="N", help="validate in every N-th generation")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()

    network, weights, statistics, curve = evolve(mjrun.read_task(options.task), options)
    save(options.output, network, weights, statistics)
    with options.output.with_suffix(".csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["generation", "population", "return", "success"])
        writer.writerows([int(row[0]), *(f"{value:.6g}" for value in row[1:])] for row in curve)


if __name__ == "__main__":
    main()
