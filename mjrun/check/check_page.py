"""The page about a check: a card per finding, with a picture of the objects that it is about, and a card per fix.

A picture shows the objects that the message names, coloured, in a grey model.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import mujoco
import numpy as np

from mjrun.check.check import CheckResult, worst_first
from mjrun.check.context import CheckContext
from mjrun.check.finding import SEVERITIES, Finding, FixedModelCopy, ModelCheckResult, without_repeats
from mjrun.check.rule_runner import RULES
from mjrun.check.rules.bodies import INFINITE
from mjrun.errors import ModelError, NoRendererError, clean, counted
from mjrun.formats.image_encoding import ImageData, jpeg
from mjrun.model.names import COUNTS
from mjrun.model.sources import source_of
from mjrun.model.xml_source import XmlSource
from mjrun.plotting.html_page import MAKER, Page, PageCard, PageFactTable, data_uri, origin, write_page
from mjrun.rendering.single_render import render
from mjrun.rendering.visual import Visual
from mjrun.reporter import Reporter

SIZE = (560, 420)
DRAWN = ("geom", "body", "joint", "site", "actuator")  # kinds whose objects belong to a body
MAX_OBJECTS = 5000  # of one kind; the names of more take long to look for
OTHERS, STATIC = (0.62, 0.65, 0.7, 0.35), (0.62, 0.65, 0.7, 0.15)
FLOOR, MARKED_FLOOR = (0.8, 0.82, 0.85, 1.0), (0.62, 0.76, 0.93, 1.0)
COLOURS = ((0.89, 0.29, 0.16, 1.0), (0.12, 0.45, 0.85, 1.0))  # of the object, and of others that the message names
CONTACTS = "5"  # the topic of contacts: contact points and hulls are drawn, and what touches is transparent
CONTACT_ALPHA = 0.6
DISTANCE = 3.2  # of the camera, relative to the radius of what is coloured
CLOSEST = 0.15  # radius relative to the extent of the model, so that its surroundings are visible
BACKGROUND = (236, 238, 241)
AMBIENT, DIFFUSE = 0.5, 0.5  # of the only light, at the camera
VIEW = (140.0, -25.0)  # azimuth and elevation [degrees]
MAX_CARDS = 300
MAX_PICTURES = 100
VISIBLE = ("geom", "key_qpos")  # the beginnings of fields whose changes can be seen


class FindingRenderer:
    """A renderer of the findings of one model.

    Raises:
      ModelError: the model does not load.
    """

    def __init__(self, path: str) -> None:
        self._model = source_of(path).load()
        self._model.light_active[:] = 0
        self._model.vis.headlight.active = 1
        self._model.vis.headlight.ambient[:], self._model.vis.headlight.diffuse[:] = AMBIENT, DIFFUSE
        self._context = CheckContext(Path(path), self._model, None, XmlSource(Path(path)))
        self._data = mujoco.MjData(self._model)
        self._objects = {
            self._context.object(kind, index): (kind, index)
            for kind in (*DRAWN, "keyframe")
            for index in range(min(getattr(self._model, COUNTS[kind]), MAX_OBJECTS))
        }

    def picture(self, finding: Finding) -> bytes:
        """Returns a JPEG of the objects that a finding names; empty if they are not visible.

        Raises:
          NoRendererError: nothing renders here.
        """
        named = [self._objects[name] for name in self._names(finding)]
        geoms = [self._geoms(kind, index) for kind, index in named if kind != "keyframe"]
        if not any(geoms):
            return b""
        start = next((index for kind, index in named if kind == "keyframe"), None)
        mujoco.mj_resetData(self._model, self._data)
        if start is not None:
            mujoco.mj_resetDataKeyframe(self._model, self._data, start)
        mujoco.mj_forward(self._model, self._data)

        touches = finding.code[2] == CONTACTS
        self._colour(geoms, CONTACT_ALPHA if touches else 1.0)
        shown = ("contactpoint", "convexhull") if touches else ()
        visual = Visual(show=shown, hide=("skybox",), groups={"geom": tuple(range(6))})
        camera = self._camera([geom for part in geoms for geom in part])
        pixels = render(self._model, self._data, camera, SIZE, visual=visual)
        is_empty = np.isinf(render(self._model, self._data, camera, SIZE, "depth", visual)) & ~pixels.any(axis=2)
        pixels[is_empty] = BACKGROUND
        return jpeg(ImageData(pixels, 0, None, {}))

    def _names(self, finding: Finding) -> Iterator[str]:
        """Yields the objects that a finding names, its own first."""
        if finding.object in self._objects:
            yield finding.object
        yield from (name for name in self._objects if name in finding.text and name != finding.object)

    def _geoms(self, kind: str, index: int) -> list[int]:
        """Returns the geoms of an object."""
        model = self._model
        if kind == "geom":
            return [index]
        if kind == "actuator":
            if int(model.actuator_trntype[index]) != int(mujoco.mjtTrn.mjTRN_JOINT):
                return []
            kind, index = "joint", int(model.actuator_trnid[index, 0])
        owners = {"joint": model.jnt_bodyid, "site": model.site_bodyid}
        body = int(owners[kind][index]) if kind in owners else index
        welded = model.body_weldid[model.geom_bodyid] == model.body_weldid[body]
        own = model.geom_bodyid == body
        return [int(geom) for geom in np.flatnonzero(own if own.any() else welded)]

    def _colour(self, geoms: Sequence[Sequence[int]], alpha: float) -> None:
        model = self._model
        model.geom_matid[:] = -1
        is_static = model.body_weldid[model.geom_bodyid] == 0
        model.geom_rgba[:] = np.where(is_static[:, None], STATIC, OTHERS)
        is_floor = np.isin(model.geom_type, INFINITE)
        model.geom_rgba[is_floor] = FLOOR
        for number, part in reversed([*enumerate(geoms)]):
            model.geom_rgba[list(part)] = (*COLOURS[min(number, 1)][:3], alpha)
            model.geom_rgba[[geom for geom in part if is_floor[geom]]] = MARKED_FLOOR

    def _camera(self, geoms: Sequence[int]) -> mujoco.MjvCamera:
        """Returns a camera that looks at geoms."""
        finite = [geom for geom in geoms if self._model.geom_rbound[geom] > 0] or list(geoms)
        radii = self._model.geom_rbound[finite]
        low = (self._data.geom_xpos[finite] - radii[:, None]).min(axis=0)
        high = (self._data.geom_xpos[finite] + radii[:, None]).max(axis=0)
        radius = max(float(np.linalg.norm(high - low)) / 2, CLOSEST * float(self._model.stat.extent))
        camera = mujoco.MjvCamera()
        camera.lookat[:] = (low + high) / 2
        camera.distance = DISTANCE * radius
        camera.azimuth, camera.elevation = VIEW
        return camera


class FindingCards:
    """The cards of a page; pictures are left out where nothing renders.

    Args:
      reporter: the reporter of what is left out.

    Attributes:
      fixes: the cards of fixes.
    """

    def __init__(self, reporter: Reporter) -> None:
        self._reporter = reporter
        self.fixes: list[PageCard] = []
        self._pictures = 0
        self._can_render = True

    def of(self, result: ModelCheckResult) -> Iterator[PageCard]:
        """Yields a card for each finding of a model, the worst first."""
        renderer = self._renderer_of(result.model) if result.loads and result.findings else None
        for finding in sorted(result.findings, key=lambda each: -SEVERITIES.index(each.severity)):
            image = self._picture(renderer, finding)
            yield _card(finding, finding.severity, finding.remedy.splitlines(), [image] if image else [])

    def add_fixes(self, copy: FixedModelCopy, findings: Sequence[Finding]) -> None:
        """Adds a card for each finding that is fixed in the copy of a model, with pictures of both if it is visible."""
        visible = [f for f in findings if any(field.startswith(VISIBLE) for fix in f.fixes for field, _ in fix.changes)]
        renderers = [self._renderer_of(str(path)) for path in (copy.original, copy.path)] if visible else []
        for finding in findings:
            images = [self._picture(renderer, finding) for renderer in renderers] if finding in visible else []
            caption = ["The pictures show it before and after the fix."] if images and all(images) else []
            self.fixes.append(_card(finding, "fix", caption, images if caption else []))

    def _renderer_of(self, path: str) -> FindingRenderer | None:
        if not self._can_render or self._pictures >= MAX_PICTURES:
            return None
        try:
            return FindingRenderer(path)
        except ModelError:  # changed since, or a task
            return None

    def _picture(self, renderer: FindingRenderer | None, finding: Finding) -> bytes:
        if renderer is None or not self._can_render or self._pictures >= MAX_PICTURES:
            return b""
        try:
            image = renderer.picture(finding)
        except NoRendererError as error:
            self._reporter.warn(f"the page has no pictures: {str(error).partition(chr(10))[0]}")
            self._can_render = False
            return b""
        self._pictures += bool(image)
        return image


def write_check_page(path: str, result: CheckResult, summary: str, makers: FindingCards, command: str) -> None:
    """Writes the page, with the cards of fixes at the end.

    Args:
      command: the command line, for the page.

    Raises:
      BadValueError: `path` does not end with .html.
      FileError: the page cannot be written.
    """
    cards = list[PageCard]()
    shown = [*without_repeats(worst_first(result.models))]
    for model in shown:
        if len(cards) < MAX_CARDS:
            cards += makers.of(model)
    cards += makers.fixes
    found = sum(len(model.findings) for model in shown)
    notes = [summary] + ([f"{counted(found - MAX_CARDS, 'more finding')} …"] if found > MAX_CARDS else [])
    versions = {"mujoco": mujoco.mj_versionString(), "numpy": np.__version__}
    models = [model.model for model in result.models[:MAX_CARDS]]
    page = Page(
        "Check of models",
        MAKER,
        cards=cards[:MAX_CARDS],
        facts=[_models(result)] if found else [],
        manifests=[origin("This check", command, models, versions)],
        notes=notes,
    )
    write_page(path, page)


def _card(finding: Finding, level: str, others: Sequence[str], images: Sequence[bytes]) -> PageCard:
    place = finding.file + (f":{finding.line}" if finding.line else "")
    return PageCard(
        f"{finding.code} {RULES[finding.code].title}",
        level,
        tuple(filter(None, (clean(place), clean(finding.object)))),
        tuple(clean(text) for text in (finding.text, *others)),
        tuple(data_uri("image/jpeg", image) for image in images),
    )


def _models(result: CheckResult) -> PageFactTable:
    rows: list[tuple[str, ...]] = []
    faulty = [model for model in worst_first(result.models) if model.findings or not model.loads]
    for model in faulty[:MAX_CARDS]:
        counts = [str(model.count(severity) or "") for severity in reversed(SEVERITIES)]
        rows.append((clean(model.model), *counts, "yes" if model.loads else "no"))
    heads = ("Model", "Errors", "Warnings", "Notes", "Loads")
    return PageFactTable("Models", "Models with findings, the worst first", heads, rows, (1, 2, 3))
