"""XML that is hostile as a text: encodings, control characters, bombs of entities, deep nesting, odd names."""

import itertools
from collections.abc import Iterator, Mapping

from tests.scoreboard.data import inputs_of
from tests.scoreboard.forms.form import EITHER, REFUSED, Content, Form, mjcf, simple

MODEL = mjcf('<!-- {0} --><worldbody><body name="{1}"><geom size=".1"/></body></worldbody>', 'model="{2}"')
INPUTS = inputs_of(__name__)
ESCAPES: Mapping[str, str] = INPUTS["ESCAPES"]
HINGE = '<worldbody><body name="b"><joint name="j"/><geom name="g" size=".1"/><site name="s"/></body></worldbody>'
# Models that are right except for a name or a text {0} of the user.
PLACES: Mapping[str, str] = INPUTS["PLACES"]
EVERY = 3  # each name is tried in a third of the places


def _escaped(text: str) -> str:
    """Returns text as character references, the usual spelling of control characters in an attribute."""
    return "".join(f"&#{ord(c)};" if not c.isalnum() else c for c in text)


def forms() -> Iterator[Form]:
    yield from _escapes()
    yield from _encodings()
    yield from _references()
    yield from _nesting()


def _escapes() -> Iterator[Form]:
    for i, (what, text) in enumerate(ESCAPES.items()):
        for j, (place, inner) in enumerate(PLACES.items()):  # raw or escaped, in turn; half of the places each
            model = mjcf(inner, 'model="{0}"' if place == "model" else "")
            how, written = ((", escaped,", _escaped(text)), ("", text))[(i + j) % 4 // 2]
            if (i + j) % 2:
                yield Form(f"{what}{how} in a {place}", {"model.xml": model.replace("{0}", written)})
        comment = mjcf(f"<!-- {text} --><{text}/>")
        yield Form(f"{what} in a comment and a tag", {"model.xml": comment}, loads=REFUSED)
        file: dict[str, Content] = {f"{text.replace('/', '')}.xml": mjcf(HINGE)}
        yield Form(f"{what} in the model's file name", file, next(iter(file)))
        broken: dict[str, Content] = {f"{text.replace('/', '')}.xml": "<mujoco><unknown/></mujoco>"}
        yield Form(f"{what} in a broken model's file name", broken, next(iter(broken)), REFUSED)


def _encodings() -> Iterator[Form]:
    text = MODEL.format("ä", "knee", "ä")
    for what, encoding in INPUTS["ENCODINGS"].items():
        yield Form(f"{what}", {"model.xml": text.encode(encoding, "replace")})
        declared = f'<?xml version="1.0" encoding="{encoding}"?>\n{text}'
        yield Form(f"{what}, declared", {"model.xml": declared.encode(encoding, "replace")})
    for encoding in INPUTS["DECLARED"]:
        yield Form(f"declared {encoding[:20]}", {"model.xml": f'<?xml version="1.0" encoding="{encoding}"?>\n{text}'})
    for what, content in INPUTS["BYTES"].items():
        for place in range(3):
            parts = [b"x"] * place + [content] + [b"x"] * (2 - place)
            model = MODEL.encode()
            for i, part in enumerate(parts):
                model = model.replace(b"{%d}" % i, part)
            yield Form(f"{what} in the {('comment', 'body', 'model')[place]}", {"model.xml": model})
        yield Form(f"{what} before all", {"model.xml": content + text.encode()})
        yield Form(f"{what} behind all", {"model.xml": text.encode() + content})
        yield Form(f"{what} as an archive", {"model.zip": content * 50}, "model.zip", REFUSED)
        name = content.replace(b"\0", b"").decode(errors="surrogateescape") + ".xml"
        yield Form(
            f"{what} in the file name", {name: text}, name, REFUSED if "\udc80" <= max(name) <= "\udcff" else None
        )
    for what, content in {
        **INPUTS["CONTENTS"],
        "only carriage returns": text.replace("\n", "\r").encode(),
        "a model in upper case": text.upper().encode(),
    }.items():
        for name in ("model.xml", "model.urdf", "model.mjb", "model.zip"):
            yield Form(f"{what} as {name}", {name: content}, name)


def _references() -> Iterator[Form]:
    for code in ("0", "1", "27", "155", "x202e", "xD800", "xFFFE", "1114112", "99999999999999", "-1", "", "x"):
        yield Form(f"a reference to &#{code};", {"model.xml": MODEL.format("", f"&#{code};", "")})
    laughs = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 12))
    secret = '<!ENTITY x SYSTEM "file:///etc/passwd">'
    for what, entities, use in (
        ("a billion laughs", '<!ENTITY l0 "ha">' + laughs, "&l11;"),
        ("quadratic laughs", f'<!ENTITY l0 "{"ha" * 50000}">', "&l0;" * 2000),
        ("an entity of itself", '<!ENTITY x "&x;">', "&x;"),
        ("an entity that is a file", secret, "&x;"),
        ("an entity that is an address", '<!ENTITY x SYSTEM "http://127.0.0.1:9/x">', "&x;"),
        ("a parameter entity", '<!ENTITY % p SYSTEM "file:///etc/passwd"> %p;', "x"),
    ):
        doctype = f"<!DOCTYPE mujoco [{entities}]>"
        yield Form(f"{what} in a name", {"model.xml": doctype + MODEL.format("", use, "")})
        yield Form(f"{what} as text", {"model.xml": doctype + f"<mujoco>{use}</mujoco>"})
    yield Form("a DTD from a file", {"model.xml": '<!DOCTYPE mujoco SYSTEM "file:///etc/passwd"><mujoco/>'})
    stylesheet = '<?xml-stylesheet href="file:///etc/passwd"?>'
    yield Form("a style sheet", {"model.xml": stylesheet + "<mujoco/>"})
    yield Form(
        "XInclude",
        {
            "model.xml": '<mujoco xmlns:xi="http://www.w3.org/2001/XInclude">'
            '<xi:include href="/etc/passwd" parse="text"/></mujoco>'
        },
        loads=REFUSED,
    )


def _nesting() -> Iterator[Form]:
    for depth in (50, 500, 5000, 100000):
        for tag, last in (("body", '<geom size=".1"/>'), ("frame", '<geom size=".1"/>'), ("unknown", "")):
            text = f"<worldbody>{f'<{tag}>' * depth}{last}{f'</{tag}>' * depth}</worldbody>"
            yield simple(f"{depth} of {tag} in one another", text)
        hinges = '<body pos="0 0 1"><joint/><geom size=".1"/>' * depth + "</body>" * depth
        yield simple(
            f"a chain of {depth} hinges",
            f"<worldbody>{hinges}</worldbody>",
            REFUSED if depth > 5000 else EITHER,
            runs=frozenset({0, 3, 4}),
        )
        classes = "".join(f'<default class="c{i}">' for i in range(depth)) + "</default>" * depth
        yield simple(f"{depth} classes in one another", f"<default>{classes}</default>")
        yield Form(f"{depth} open tags", {"model.xml": "<mujoco>" + "<worldbody>" * depth}, loads=REFUSED)
    for what, text in {
        "a comment of 30 MB": f"<mujoco><!--{'x' * 30_000_000}--></mujoco>",
        "a text of 30 MB": f"<mujoco>{'x' * 30_000_000}</mujoco>",
        "a name of 10 MB": MODEL.format("", "x" * 10_000_000, ""),
        "100,000 attributes": "<mujoco " + " ".join(f'a{i}="1"' for i in range(100_000)) + "/>",
        "one attribute 100,000 times": "<mujoco " + 'model="1" ' * 100_000 + "/>",
        "100,000 unknown elements": f"<mujoco>{'<unknown/>' * 100_000}</mujoco>",
        "100,000 processing instructions": "<?x y?>" * 100_000 + "<mujoco/>",
        "a CDATA of brackets": f"<mujoco><![CDATA[{']' * 100_000}]]></mujoco>",
        "spaces": " " * 5_000_000 + "<mujoco/>",
        "100,000 quotes": '<mujoco a="' + "'" * 100_000,
        "100,000 opening brackets": "<" * 100_000,
    }.items():
        yield Form(what, {"model.xml": lambda text=text: text.encode()})


def names() -> Iterator[Form]:
    """Yields names that are long, empty, double, or look like something else."""
    for i, (what, name) in enumerate(INPUTS["NAMES"].items()):
        for place, inner in itertools.islice(PLACES.items(), i % EVERY, None, EVERY):
            if len(name) > 1000 and "missing" in place:
                continue
            model = mjcf(inner, 'model="{0}"' if place == "model" else "").replace("{0}", name)
            long = len(name) > 60000
            yield Form(f"{what} as {place}", {"model.xml": model}, loads=EITHER if long else None)
    for stem in INPUTS["FILES"]:
        for what, text, loads in (("model", mjcf(HINGE), None), ("broken model", "<mujoco><a/></mujoco>", REFUSED)):
            name = f"./{stem}.xml"
            yield Form(f"a {what} in {stem[:20]}.xml", {name: text}, name, loads)
    many = "".join(f'<body name="{"n" * 2000}{i}"/>' for i in range(300))
    yield Form("300 names of 2,000 characters", {"model.xml": mjcf(f"<worldbody>{many}</worldbody>")})
