"""Episodes against a bare MuJoCo loop, and against the same episodes beside others."""

import math
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.evaluation.episode import EpisodeGroupSpec, PolicyChoice, player_of
from mjrun.formats.table_reader import read_table
from mjrun.model.override import Override
from mjrun.model.sources import parse_source
from mjrun.model.variants import model_bytes
from mjrun.options.simulation import NO_DISTURBANCES, Disturbances, PushKind
from mjrun.outputs.trace import Trace
from mjrun.simulation.simulation import Simulation
from mjrun.task.task import Reset, Task, Termination
from mjrun.task.worlds import TaskWorlds
from tests.evaluation.tasks import cart_task, write_policies

SEEDS = range(40)


def policy(observation: np.ndarray) -> np.ndarray:
    return np.array([-2.0 * observation[0] - 1.2 * observation[1]])


def bare_episode(task: Task, seed: int) -> tuple[float, int, str]:
    """Computes the return, the control periods and the ending of an episode by mj_step alone."""
    worlds = TaskWorlds(task, 1, threads=1)
    worlds.reset([seed])
    model = task.load()
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, worlds.state(0), mujoco.mjtState.mjSTATE_INTEGRATION)
    total = 0.0
    for period in range(1, 76):
        data.ctrl[:] = policy(np.array([data.qpos[0], data.qvel[0]]))
        mujoco.mj_step(model, data, 2)
        total += -abs(data.qpos[0]) + -0.01 * data.ctrl[0] ** 2
        if abs(data.qpos[0]) < 0.02 and abs(data.qvel[0]) < 0.1:
            return total, period, "home"
        if abs(data.qpos[0]) > 1:
            return total, period, "lost"
    return total, 75, "timeout"


def spec(folder: Path, name: str = "act", **options: object) -> EpisodeGroupSpec:
    return EpisodeGroupSpec(cart_task(folder), PolicyChoice(f"{write_policies(folder)}:{name}"), **options)  # type: ignore[arg-type]


def test_episodes_are_those_of_a_bare_loop(tmp_path: Path) -> None:
    task = cart_task(tmp_path)
    episodes = player_of(spec(tmp_path)).play(SEEDS)
    assert [each.seed for each in episodes] == [*SEEDS]
    for each in episodes:
        total, periods, ending = bare_episode(task, each.seed)
        assert (each.steps, each.ending) == (periods, ending)
        assert each.total == pytest.approx(total, rel=1e-12)
        assert each.total == pytest.approx(math.fsum(each.rewards.values()), rel=1e-12)
        assert each.length == periods * 2 / 100  # exact, rounded once, as the times of a trace
        assert each.outcome == {"home": "success", "lost": "failure", "timeout": "timeout"}[ending]
    assert {each.ending for each in episodes} == {"home", "lost", "timeout"}


def test_what_holds_at_the_start_ends_an_episode_after_its_first_period_if_it_still_holds(tmp_path: Path) -> None:
    """As in Gymnasium: `reset` ends nothing, `step` does."""
    ends = {
        "reset": Termination(when="time < 0.01", as_="failure"),
        "out": Termination(when="time < 0.03", as_="failure"),
    }
    for name, steps, ending in (("reset", 75, "timeout"), ("out", 1, "out")):
        task = replace(cart_task(tmp_path), terminations={name: ends[name]})
        worlds = TaskWorlds(task, 1, threads=1)
        worlds.reset([0])
        assert [each and each.name for each in worlds.ended_at_start] == [name]
        (episode,) = player_of(EpisodeGroupSpec(task, PolicyChoice("zero"))).play([0])
        assert (episode.steps, episode.ending) == (steps, ending)


def test_company_changes_no_bit(tmp_path: Path) -> None:
    one = player_of(spec(tmp_path))
    together = one.play(SEEDS)
    assert [episode for seed in SEEDS for episode in one.play([seed])] == together
    assert one.play([7, 3, 5]) == [together[7], together[3], together[5]]
    assert player_of(spec(tmp_path)).play(SEEDS[30:]) == together[30:]


def test_models_of_worlds_take_no_more_memory_than_the_budget(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    varied = replace(
        spec(tmp_path), task=replace(cart_task(tmp_path), reset=Reset(vary={"opt.density": "uniform(0, 9)"}))
    )
    expected = player_of(varied).play(SEEDS)
    counts: list[int] = []
    real = TaskWorlds.__init__

    def counted(self: TaskWorlds, task: Task, count: int, threads: int = 0) -> None:
        counts.append(count)
        real(self, task, count, threads)

    monkeypatch.setattr(TaskWorlds, "__init__", counted)
    monkeypatch.setattr("mjrun.evaluation.episode.BYTES", int(3.5 * model_bytes(varied.task.load())))
    assert player_of(varied).play(SEEDS) == expected
    assert counts == [1, 3]


def test_an_action_that_is_no_number_is_reported_with_its_step(tmp_path: Path) -> None:
    (episode,) = player_of(spec(tmp_path, "Broken")).play([3])
    assert (episode.status, episode.exit_code, episode.steps) == ("failed", 4, 7)
    assert "step 14, time 0.14 s: push = nan" in episode.message
    assert math.isnan(episode.total)


@pytest.mark.parametrize("worlds", [1, 3, 128])
def test_an_episode_that_fails_costs_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, worlds: int) -> None:
    """Each policy of a seed acts as if it were alone, also in a world whose last episode failed."""
    monkeypatch.setattr("mjrun.evaluation.episode.SIDE_BY_SIDE", worlds)
    endless = replace(cart_task(tmp_path), terminations={})
    late = player_of(EpisodeGroupSpec(endless, PolicyChoice(f"{write_policies(tmp_path)}:NotNumber"))).play(
        range(4, 12)
    )
    zero = player_of(EpisodeGroupSpec(endless, PolicyChoice("zero"))).play(range(4, 12))
    assert late[:3] == zero[:3]  # only the episodes from seed 7 on fail, the later ones at earlier steps
    assert [episode.steps for episode in late[3:]] == [40 - 3 * (seed - 5) for seed in range(7, 12)]
    assert {episode.status for episode in late[3:]} == {"failed"}


def test_a_policy_of_another_size_is_reported(tmp_path: Path) -> None:
    (episode,) = player_of(spec(tmp_path, "wide")).play([0])
    assert "3 numbers" in episode.message
    assert episode.exit_code == 2


def test_a_task_without_rewards_has_lengths_and_endings(tmp_path: Path) -> None:
    plain = EpisodeGroupSpec(cart_task(tmp_path, rewards=False), PolicyChoice(f"{write_policies(tmp_path)}:act"))
    rewarded = player_of(spec(tmp_path)).play(SEEDS[:5])
    for episode, other in zip(player_of(plain).play(SEEDS[:5]), rewarded, strict=True):
        assert (episode.total, episode.rewards) == (0.0, {})
        assert (episode.steps, episode.ending) == (other.steps, other.ending)


def test_a_model_alone_is_no_task() -> None:
    with pytest.raises(UsageError, match="write a task document"):
        player_of(EpisodeGroupSpec(parse_source("scene:car"), PolicyChoice("zero")))


def test_an_environment_is_played_as_gymnasium_plays_it() -> None:
    import gymnasium

    episodes = player_of(EpisodeGroupSpec(parse_source("gym:InvertedPendulum-v5"), PolicyChoice("zero"))).play([4, 9])
    environment = gymnasium.make("InvertedPendulum-v5")
    for each in episodes:
        environment.reset(seed=each.seed)
        total, periods, over = 0.0, 0, False
        while not over:
            _, reward, terminated, truncated, _ = environment.step(np.zeros(1, np.float32))
            total, periods, over = total + float(reward), periods + 1, terminated or truncated
        assert (each.total, each.steps) == (total, periods)
        assert (each.ending, each.outcome) == ("terminated", "failure")
    environment.close()


def test_returns_are_those_of_the_environment_of_gymnasium_to_the_bit(tmp_path: Path) -> None:
    import mjrun.gym

    task = cart_task(tmp_path)
    environment = mjrun.gym.make(task)
    for each in player_of(spec(tmp_path)).play([2, 6, 11]):
        observation, _ = environment.reset(seed=each.seed)
        total, periods, over = 0.0, 0, False
        while not over:
            observation, reward, terminated, truncated, _ = environment.step(policy(observation))
            total, periods, over = total + float(reward), periods + 1, terminated or truncated
        assert (each.total, each.steps) == (total, periods)
    environment.close()


METRICS = {
    "far": "max(abs(qpos/slider))",
    "effort": "mean(abs(ctrl/push))",
    "seen": "last(obs/v)",
    "done": "mean(abs(action/push))",
    "total": "last(return)",
    "end": "last(time)",
    "never": "first(time, qpos/slider > 50)",
}


def test_metrics_are_those_of_the_trace_at_control_instants(tmp_path: Path) -> None:
    task, policy = cart_task(tmp_path), f"{write_policies(tmp_path)}:act"
    plain = player_of(EpisodeGroupSpec(task, PolicyChoice(policy))).play([3, 8])
    result = player_of(EpisodeGroupSpec(task, PolicyChoice(policy), tuple(METRICS.items()))).play([3, 8])
    for episode, other in zip(result, plain, strict=True):
        path = tmp_path / f"{episode.seed}.csv"
        simulation = Simulation(task, policy=policy, seed=episode.seed)
        Trace(simulation, str(path), probe=["qpos", "ctrl", "obs", "action", "return"], every=2).run()
        table = read_table(path).columns
        expected = {
            "far": np.abs(table["qpos/slider"]).max(),
            "effort": np.abs(table["ctrl/push"]).mean(),
            "seen": table["obs/v"][-1],
            "done": np.abs(table["action/push"]).mean(),
            "total": episode.total,
            "end": episode.length,
            "never": np.nan,
        }
        assert episode.metrics == pytest.approx([*expected.values()], rel=1e-12, nan_ok=True)
        assert table["return"][-1] == episode.total
        assert (episode.total, episode.steps, episode.ending) == (other.total, other.steps, other.ending)


def test_an_environment_is_measured_too() -> None:
    spec = EpisodeGroupSpec(parse_source("gym:InvertedPendulum-v5"), PolicyChoice("zero"), (("last", "last(return)"),))
    (episode,) = player_of(spec).play([2])
    assert episode.metrics == (episode.total,)


def test_a_metric_of_nothing_is_reported_at_once(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="qpos/knee") as caught:
        player_of(EpisodeGroupSpec(cart_task(tmp_path), PolicyChoice("zero"), (("m", "max(qpos/knee)"),)))
    assert caught.value.path == ("metric", "m")


def test_an_episode_that_becomes_unstable_is_measured_as_far_as_it_goes(tmp_path: Path) -> None:
    task = replace(cart_task(tmp_path), overrides=(Override("opt.gravity", "1e11,0,0"),))
    plain = player_of(EpisodeGroupSpec(task, PolicyChoice("zero"))).play([1])
    (episode,) = player_of(EpisodeGroupSpec(task, PolicyChoice("zero"), (("rows", "count(time)"),))).play([1])
    assert episode.ending == "unstable"
    assert [replace(episode, metrics=())] == plain
    assert episode.metrics == (float(episode.steps),)  # the start, and all instants but the last


@pytest.mark.parametrize("name", ["NotNumber", "Late"])
def test_what_fails_fails_in_the_same_way_when_it_is_measured(tmp_path: Path, name: str) -> None:
    endless = replace(spec(tmp_path, name), task=replace(cart_task(tmp_path), terminations={}))
    plain = player_of(endless).play([6, 8, 7])
    measured = player_of(replace(endless, metrics=(("m", "max(time)"),))).play([6, 8, 7])
    assert [episode.status for episode in plain] == ["ok", "failed", "failed"]
    for one, other in zip(plain, measured, strict=True):
        assert (one.message, one.exit_code, one.steps) == (other.message, other.exit_code, other.steps)
        assert np.isfinite(other.metrics[0]) == (one.status == "ok")


PUSHES = ("cart=30/0/0@0.1+0.05", "cart=-20/0/0@0.4+0.1")


def pushed(folder: Path, pushes: tuple[str, ...], name: str = "act", **options: object) -> EpisodeGroupSpec:
    return replace(spec(folder, name, **options), disturbances=Disturbances(tuple(map(PushKind().parse, pushes))))


def test_disturbed_episodes_are_those_of_a_bare_loop(tmp_path: Path) -> None:
    """Each force acts on its steps alone; without a force or noise, nothing differs from other episodes."""
    task, model = cart_task(tmp_path), cart_task(tmp_path).load()
    forces = np.zeros(200)
    forces[10:15], forces[40:50] = 30, -20
    disturbed = pushed(tmp_path, PUSHES)
    disturbed = replace(disturbed, disturbances=replace(disturbed.disturbances, ctrl_noise=0.4))
    for episode in player_of(disturbed).play(range(6)):
        noise = 0.4 * np.random.default_rng([episode.seed, 1, 0]).standard_normal((1024, 1))
        worlds = TaskWorlds(task, 1, threads=1)
        worlds.reset([episode.seed])
        data = mujoco.MjData(model)
        mujoco.mj_setState(model, data, worlds.state(0), mujoco.mjtState.mjSTATE_INTEGRATION)
        total, ending, period = 0.0, "", 0
        while not ending:
            period += 1
            wanted = policy(np.array([data.qpos[0], data.qvel[0]]))
            for step in range(2 * period - 2, 2 * period):
                data.ctrl[:] = wanted + noise[step]
                data.xfrc_applied[1, 0] = forces[step]
                mujoco.mj_step(model, data)
            total += -abs(data.qpos[0]) + -0.01 * data.ctrl[0] ** 2
            is_home = abs(data.qpos[0]) < 0.02 and abs(data.qvel[0]) < 0.1
            ending = "home" if is_home else "lost" if abs(data.qpos[0]) > 1 else "timeout" if period == 75 else ""
        assert (episode.steps, episode.ending) == (period, ending)
        assert episode.total == pytest.approx(total, rel=1e-12)
    gentle = player_of(pushed(tmp_path, ("cart=0/0/0@0+1",))).play(range(6))
    assert gentle == player_of(spec(tmp_path)).play(range(6))


def test_a_push_may_make_an_episode_unstable_or_find_a_policy_that_fails(tmp_path: Path) -> None:
    (episode,) = player_of(pushed(tmp_path, ("cart=1e14/0/0@0.1+0.1",), metrics=(("n", "count(time)"),))).play([1])
    assert (episode.ending, episode.outcome, episode.status) == ("unstable", "failure", "ok")
    assert episode.metrics == (float(episode.steps),)
    failing = replace(pushed(tmp_path, PUSHES, name="Late"), task=replace(cart_task(tmp_path), terminations={}))
    (late,) = player_of(failing).play([7])
    (plain,) = player_of(replace(failing, disturbances=NO_DISTURBANCES)).play([7])
    assert (late.status, late.steps, late.message) == ("failed", plain.steps, plain.message)
    with pytest.raises(UnknownNameError, match="wheel"):
        player_of(pushed(tmp_path, ("wheel=1/0/0@0+1",)))
