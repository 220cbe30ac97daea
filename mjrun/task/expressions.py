"""The expressions of a task in n worlds: rewards, terminations, and observed values.

Those of a single world are compiled to Python: on single numbers, an operation of NumPy takes about 1 µs and one of
Python a fortieth of that. A program is a function with one line for each value; common parts of several expressions are
computed once. Its numbers are bit for bit those that `mjrun.probe.expression` computes on many rows. No text of a
document gets into the source: names become places in an array, and functions are passed as objects.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from mjrun.errors import concerning
from mjrun.probe import expression as tree
from mjrun.probe.task_expression import (
    TaskEvaluator,
    TaskExpression,
    TaskVocabulary,
    parse_task_condition,
    parse_task_value,
)
from mjrun.task.batch_columns import NumberSource, as_slice
from mjrun.task.episode import PossibleEndings
from mjrun.task.task import TIMED_OUT, UNSTABLE, Task

ACTION, COMMAND, TIME = "action/", "command/", "time"  # columns of a task in addition to those of its model
RUNNING = -1  # the code of an episode that has not ended
NOTHING: Mapping[str, Any] = {}
Judge = Callable[[float], tuple[float, list[float], int]]
Fill = Callable[[np.ndarray, float], None]
# Python's operators that are bit for bit those of NumPy.
OPERATORS: dict[tree.Function, str] = {
    tree.ARITHMETIC["+"]: "+",
    tree.ARITHMETIC["-"]: "-",
    tree.ARITHMETIC["*"]: "*",
    np.add: "+",
}
OF_NUMBERS = {
    *OPERATORS,
    tree.ARITHMETIC["/"],
    abs,
}  # functions that are faster on each of a few numbers than on a vector
FEW = 7  # the most numbers that NumPy adds in order; it adds more of them pairwise
# Numbers that Python copies one by one in less time than NumPy together: adjacent ones, and others.
ADJACENT, SCATTERED = 2, 9


class ExpressionInputs(NamedTuple):
    """The inputs of k worlds up to a control instant; of a single world where the axis of worlds is missing.

    Attributes:
      instants: control instants since the reset `(k,)`.
      actions: the last ones `(k, nact)`.
      commands: `(k, ncommands)`.
    """

    instants: Any
    actions: np.ndarray
    commands: np.ndarray


class TaskExpressions:
    """The rewards, terminations and observed values of n worlds.

    Args:
      task: the task with the expressions.
      columns: the columns that they can read.
      values: the observed values, by the name of the term.
      names: the names of the numbers of an action and of the commands.
      count: the number of worlds.

    Attributes:
      measured: the columns of the model that they read.
      actions, commands: the columns with the numbers of an action and of the commands.
      reads_time, reads_actions, reads_commands: whether they read any of these.
      has_values: whether any values are observed.
      endings: all possible endings; the terminations of the task first, in their order.

    Raises:
      UnknownNameError: a name is neither a column nor a function.
      UsageError: a text is not an expression.
    """

    def __init__(
        self,
        task: Task,
        columns: TaskVocabulary,
        values: Mapping[str, TaskExpression],
        names: tuple[Sequence[str], Sequence[str]],
        count: int,
    ) -> None:
        self._control_dt = task.control_dt
        rewards: list[TaskExpression] = []
        for name, reward in task.rewards.items():
            with concerning("rewards", name, "value"):
                rewards.append(parse_task_value(reward.value, columns, f"rewards.{name}"))
        conditions: list[TaskExpression] = []
        for name, termination in task.terminations.items():
            with concerning("terminations", name, "when"):
                conditions.append(parse_task_condition(termination.when, columns, f"terminations.{name}.when"))

        self._weights = [reward.weight for reward in task.rewards.values()]
        self._weight_column = np.array(self._weights, float)[:, None]
        self._rewards = [each.evaluator(count) for each in rewards]
        self._conditions = [each.evaluator(count) for each in conditions]
        self._values = {name: each.evaluator(count) for name, each in values.items()}
        self.has_values = bool(values)
        own_endings = (termination.ending(name) for name, termination in task.terminations.items())
        self.endings = PossibleEndings(own_endings, TIMED_OUT, UNSTABLE)

        self.actions = actions = [f"{ACTION}{name}" for name in names[0]]
        self.commands = commands = [f"{COMMAND}{name}" for name in names[1]]
        read = dict.fromkeys(column for each in (*rewards, *conditions, *values.values()) for column in each.columns)
        self.measured = [column for column in read if column not in {TIME, *actions, *commands}]
        self.reads_time = TIME in read
        self.reads_actions, self.reads_commands = (not read.keys().isdisjoint(own) for own in (actions, commands))
        self._layout = tree.ColumnLayout(
            [
                *self.measured,
                *(actions if self.reads_actions else ()),
                *(commands if self.reads_commands else ()),
            ]
        )

    @property
    def memory(self) -> list[np.ndarray]:
        """The previous values that they remember of each world `(count, …)`."""
        evaluators = [*self._rewards, *self._conditions, *self._values.values()]
        return [array for each in evaluators for array in each.memory]

    def columns(self, measured: np.ndarray, inputs: ExpressionInputs) -> tree.ColumnMatrix:
        """Returns the columns that they read, `(k,)` each, from those of the model `(k, len(self.measured))`."""
        read = [measured]
        read += [inputs.actions] if self.reads_actions else []
        read += [inputs.commands] if self.reads_commands else []
        matrix = np.concatenate(read, axis=-1) if len(read) > 1 else measured
        return tree.ColumnMatrix(
            self._layout, matrix, {TIME: self.time(inputs.instants)} if self.reads_time else NOTHING
        )

    def alone(
        self,
        columns: Mapping[str, NumberSource],
        measured: Mapping[int, NumberSource],
        places: Sequence[int],
        is_first: bool,
    ) -> tuple[Judge, Fill, bool]:
        """Compiles the expressions of a single world.

        Args:
          columns: the source of each column that they read.
          measured: the source of each measured number of an observation, by its place.
          places: the places of the observed values in an observation.
          is_first: whether the functions are for the first control instant of an episode.

        Returns:
          A function of the time that returns the reward, its weighted terms, and the code of the termination that
          holds; a function of an observation and the time that writes measured numbers and observed values into it; and
          whether both must be called within `np.errstate(all="ignore")`.
        """
        judging = RowFunctionBuilder(columns, is_first)
        values = [judging.value(each) for each in self._rewards]
        for index, (value, weight) in enumerate(zip(values, self._weights, strict=True)):
            judging.add(f"t{index} = float({value}) * {weight!r}")
        terms = [f"t{index}" for index in range(len(values))]
        holds = [f"{code} if {judging.value(each)} else " for code, each in enumerate(self._conditions)]
        judge = judging.function(
            "time", f"{' + '.join(['0.0', *terms])}, [{', '.join(terms)}], {''.join(holds)}{RUNNING}"
        )

        filling = RowFunctionBuilder(columns, is_first)
        filling.copy(measured, "values")
        for place, each in zip(places, self._values.values(), strict=True):
            filling.add(f"values[{place}] = {filling.value(each)}")
        return judge, filling.function("values, time", "None"), judging.uses_numpy or filling.uses_numpy

    def time(self, instants: Any) -> Any:
        """Returns the time of control instants [s], exact and rounded once."""
        return instants * self._control_dt.numerator / self._control_dt.denominator

    def begin(self, columns: tree.ColumnMatrix, ids: np.ndarray | None, count: int) -> np.ndarray:
        """Evaluates the expressions at the first instant of `count` episodes.

        Returns:
          The code of the first termination that holds there `(count,)`; −1 where none does.
        """
        with np.errstate(all="ignore"):
            for each in self._rewards:
                if each.memory:
                    each.begin(columns, ids)
            return self._codes([each.begin(columns, ids) for each in self._conditions], count)

    def advance(self, columns: tree.ColumnMatrix, ids: np.ndarray | None, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Evaluates the expressions at the end of a control period in `count` worlds.

        Returns:
          The weighted terms of the reward `(nterms, count)`, and the code of the first termination that holds
          `(count,)`; −1 where none does.
        """
        terms = np.empty((len(self._rewards), count))
        with np.errstate(all="ignore"):
            for row, each in enumerate(self._rewards):
                terms[row] = each.advance(columns, ids)
            terms *= self._weight_column
            return terms, self._codes([each.advance(columns, ids) for each in self._conditions], count)

    def values(self, columns: tree.ColumnMatrix, ids: np.ndarray | None, first: bool) -> Mapping[str, np.ndarray]:
        """Returns the observed values, `(k,)` by the name of their term; see `columns`."""
        with np.errstate(all="ignore"):
            if first:
                return {name: each.begin(columns, ids) for name, each in self._values.items()}
            return {name: each.advance(columns, ids) for name, each in self._values.items()}

    def _codes(self, conditions: Sequence[np.ndarray], count: int) -> np.ndarray:
        """Returns the code of the first condition `(count,)` bool that holds in each world."""
        codes = np.empty(count, int)
        codes.fill(RUNNING)  # np.full takes twice as long
        for code, holds in reversed([*enumerate(conditions)]):
            codes[holds] = code
        return codes


class RowFunctionBuilder:
    """A builder of a function of the time [s] and the columns of one world, line by line.

    Args:
      columns: the source of each column by name; the function reads them at every call.
      is_first: whether the function is for the first control instant of episodes.

    Attributes:
      uses_numpy: whether the function must be called within `np.errstate(all="ignore")`.
    """

    def __init__(self, columns: Mapping[str, NumberSource], is_first: bool) -> None:
        self._columns, self._is_first = columns, is_first
        self._lines: list[str] = []
        self._variables: dict[str, str] = {}  # by their assigned source
        self._vectors: dict[tuple[str, ...], str] = {}
        self._previous: dict[tree.PreviousValue, str] = {}
        self._objects: dict[str, Any] = {"isfinite": math.isfinite, "sqrt": math.sqrt}
        self.uses_numpy = False

    def value(self, evaluator: TaskEvaluator) -> str:
        """Adds the lines of an expression, with the memory of `evaluator`; returns the variable of its value."""
        for node, memory in evaluator.previous:
            now = self._number(node.operand)
            name = self._object(memory)
            before = f"{name}[0].copy()" if node.width else f"{name}.item(0)"
            self._previous[node] = now if self._is_first else self._assigned(before)
            self.add(f"{name}[0] = {now}")
        root = evaluator.root
        return self._truth(root) if isinstance(root, tree.BooleanExpression) else self._number(root)

    def add(self, line: str) -> None:
        """Adds a line of source."""
        self._lines.append(line)

    def copy(self, numbers: Mapping[int, NumberSource], target: str) -> None:
        """Adds lines that copy numbers, by their places in the array `target`."""
        left = {*numbers}
        for start in sorted(left):
            if start in left:
                source, stop = numbers[start][0], start
                while stop in left and numbers[stop][0] is source:
                    left.remove(stop)
                    stop += 1
                self._copy_vector(source, [numbers[place][1] for place in range(start, stop)], target, start)

    def function(self, parameters: str, result: str) -> Callable[..., Any]:
        """Compiles the function that returns `result`; one of its parameters is `time`."""
        source = "\n    ".join([f"def program({parameters}):", *self._lines, f"return {result}"])
        namespace = {**self._objects}
        exec(compile(source, "<expressions of a task>", "exec"), namespace)
        return namespace["program"]

    def _number(self, node: tree.NumericExpression) -> str:
        match node:
            case tree.NumberLiteral(value=number):
                return f"({number!r})" if math.isfinite(number) else self._object(number)
            case tree.ColumnReference(name=name):
                return self._column(name)
            case tree.ColumnVector(names=names):
                return self._vector(names)
            case tree.PreviousValue():
                return self._previous[node]
            case tree.FunctionCall():
                self.uses_numpy |= node.width > 0
                return self._call(node, [self._number(operand) for operand in node.operands])
            case tree.RowwiseReduction():
                return self._reduction(node)
            case tree.ConditionalValue(condition=condition, operands=(first, second)):
                holds, one, other = self._truth(condition), self._number(first), self._number(second)
                if node.width:
                    return self._numpy(np.where, holds, one, other)
                return self._assigned(f"{one} if {holds} else {other}")
        raise TypeError(node)

    def _truth(self, node: tree.BooleanExpression) -> str:
        match node:
            case tree.Comparison(operator=operator, sides=(value, _)) if operator in (tree.FINITE, tree.NOT_FINITE):
                return self._assigned(f"{'not ' if operator == tree.NOT_FINITE else ''}{self._finite(value)}")
            case tree.Comparison(operator=operator, sides=sides):
                left, right = map(self._number, sides)
                unequal = f"{left} < {right} or {left} > {right}"  # false for NaN
                return self._assigned(unequal if operator == "!=" else f"{left} {operator} {right}")
            case tree.BooleanOperation(every=every, parts=parts):
                return self._assigned((" and " if every else " or ").join(map(self._truth, parts)))
        raise TypeError(node)

    def _finite(self, value: tree.NumericExpression) -> str:
        """Returns the source of the test that a number, or every number of a vector, is finite."""
        match value:
            case tree.RowwiseReduction(
                name="max", operands=(tree.FunctionCall(functions=(function,), operands=(vector,)),)
            ):
                if function is abs and vector.width:
                    return f"all(map(isfinite, {self._number(vector)}.tolist()))"
        return f"isfinite({self._number(value)})"

    def _column(self, name: str) -> str:
        if name not in self._columns:
            return TIME
        source, place = self._columns[name]
        return self._assigned(f"{self._object(source)}.item({place})")

    def _vector(self, names: tuple[str, ...]) -> str:
        if names in self._vectors:
            return self._vectors[names]
        sources = [self._columns[name] for name in names if name in self._columns]
        if len(sources) < len(names) or any(source is not sources[0][0] for source, _ in sources):
            vector = self._numpy(np.array, f"({', '.join(map(self._column, names))},)")
        else:
            vector = self._gathered(sources[0][0], [place for _, place in sources])
        self._vectors[names] = vector
        return vector

    def _gathered(self, source: np.ndarray, places: Sequence[int]) -> str:
        """Returns the variable of a vector of some numbers of an array."""
        chosen = as_slice(np.array(places))
        if isinstance(chosen, slice):
            return self._object(source[chosen])  # a view, with the numbers of each call
        return self._assigned(f"{self._object(source)}[{self._object(chosen)}]")

    def _copy_vector(self, source: np.ndarray, chosen: Sequence[int], target: str, start: int) -> None:
        """Adds lines that copy numbers of an array to adjacent places of another one, from `start` on."""
        is_scattered = isinstance(as_slice(np.array(chosen)), np.ndarray)
        if len(chosen) <= ADJACENT or (is_scattered and len(chosen) <= SCATTERED):
            for place, index in enumerate(chosen, start):
                self.add(f"{target}[{place}] = {self._object(source)}.item({index})")
        else:
            self.add(f"{target}[{start}:{start + len(chosen)}] = {self._gathered(source, chosen)}")

    def _call(self, call: tree.FunctionCall, values: Sequence[str]) -> str:
        """Applies the functions of a call to its operands, or to one number of each."""
        result, *others = values
        if not others:
            function = call.functions[0]
            return self._assigned(f"abs({result})") if function is abs else self._numpy(function, result)
        for function, other, operand in zip(call.functions, others, call.operands[1:], strict=True):
            number = operand.value if isinstance(operand, tree.NumberLiteral) else None
            if function in OPERATORS:
                result = self._assigned(f"{result} {OPERATORS[function]} {other}")
            elif function is tree.ARITHMETIC["/"] and number:
                result = self._assigned(f"{result} / {other}")
            elif function is tree.ARITHMETIC["^"] and number == 2:
                result = self._assigned(f"{result} * {result}")
            else:
                result = self._numpy(function, result, other)
        return result

    def _reduction(self, node: tree.RowwiseReduction) -> str:
        name, is_norm = "sum" if node.name == "norm" else node.name, node.name == "norm"
        numbers = [number for operand in node.operands for number in self._numbers(operand)]
        if name == "sum" and len(numbers) <= FEW and None not in numbers:
            terms = [self._assigned(f"{number} * {number}") for number in numbers] if is_norm else numbers
            total = f"0.0 + {' + '.join(map(str, terms))}"
        else:
            vectors = [self._number(operand) for operand in node.operands]
            is_one = len(vectors) == 1 and node.operands[0].width
            vector = vectors[0] if is_one else self._numpy(np.hstack, f"({', '.join(vectors)},)")
            vector = self._assigned(f"{vector} * {vector}") if is_norm else vector
            total = self._numpy(tree.REDUCED[name], vector)
        return self._assigned(f"sqrt({total})" if is_norm else total)

    def _numbers(self, node: tree.NumericExpression) -> list[str | None]:
        """Returns the variable of each number of a vector, or of a single number; None where NumPy computes them."""
        if not node.width:
            return [self._number(node)]
        if node.width <= FEW and isinstance(node, tree.ColumnVector):
            return [self._column(name) for name in node.names]
        if node.width <= FEW and isinstance(node, tree.FunctionCall) and _is_arithmetic(node):
            operands = [self._numbers(operand) for operand in node.operands]
            columns = [numbers * (node.width // len(numbers)) for numbers in operands]
            rows = [[number for number in row if number is not None] for row in zip(*columns, strict=True)]
            if all(len(row) == len(columns) for row in rows):
                return [self._call(node, row) for row in rows]
        return [None]

    def _numpy(self, function: tree.Function, *arguments: str) -> str:
        """Returns the variable with the result of a NumPy function."""
        self.uses_numpy = True
        return self._assigned(f"{self._object(function)}({', '.join(arguments)})")

    def _assigned(self, text: str) -> str:
        """Returns the variable with the value of the source `text`."""
        if text not in self._variables:
            self._variables[text] = variable = f"v{len(self._variables)}"
            self.add(f"{variable} = {text}")
        return self._variables[text]

    def _object(self, thing: Any) -> str:
        """Returns the name of an object that has no source."""
        for name, known in self._objects.items():
            if known is thing:
                return name
        name = f"o{len(self._objects)}"
        self._objects[name] = thing
        return name


def _is_arithmetic(call: tree.FunctionCall) -> bool:
    """Returns whether Python computes the functions of a call on each number of a vector."""
    is_square = call.functions == (tree.ARITHMETIC["^"],) and getattr(call.operands[1], "value", None) == 2
    return is_square or OF_NUMBERS.issuperset(call.functions)
