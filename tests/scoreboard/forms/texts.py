"""Encodings, control characters, bombs of entities and deep nesting: XML that is hostile as a text."""

from collections.abc import Iterator

from tests.scoreboard.data import inputs_of
from tests.scoreboard.forms.form import EITHER, REFUSED, Content, Form, mjcf, simple

MODEL = mjcf('<!-- {0} --><worldbody><body name="{1}"><geom size=".1"/></body></worldbody>', 'model="{2}"')
INPUTS = inputs_of(__name__)
ESCAPES = INPUTS["ESCAPES"]
HINGE = '<worldbody><body name="b"><joint name="j"/><geom name="g" size=".1"/><site name="s"/></body></worldbody>'
# Where a name or a text of the user stands in a model that is right but for it.
PLACES = {
    "model": HINGE,
    "body": HINGE.replace('"b"', '"{0}"'),
    "joint": HINGE.replace('"j"', '"{0}"'),
    "geom": HINGE.replace('"g"', '"{0}"'),
    "camera": HINGE + '<worldbody><camera name="{0}"/></worldbody>',
    "light": HINGE + '<worldbody><light name="{0}"/></worldbody>',
    "actuator": HINGE + '<actuator><motor name="{0}" joint="j"/></actuator>',
    "sensor": HINGE + '<sensor><jointpos name="{0}" joint="j"/></sensor>',
    "tendon": HINGE + '<tendon><fixed name="{0}"><joint joint="j" coef="1"/></fixed></tendon>',
    "equality": HINGE + '<equality><joint name="{0}" joint1="j"/></equality>',
    "keyframe": HINGE + '<keyframe><key name="{0}"/></keyframe>',
    "material": '<asset><material name="{0}"/></asset>' + HINGE,
    "mesh": '<asset><mesh name="{0}" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>' + HINGE,
    "text": HINGE + '<custom><text name="t" data="{0}"/></custom>',
    "numeric": HINGE + '<custom><numeric name="{0}" data="1"/></custom>',
    "class": '<default><default class="{0}"><geom size="1"/></default></default>' + HINGE,
    # Refused: the message quotes them.
    "unknown joint": HINGE + '<actuator><motor joint="{0}"/></actuator>',
    "unknown element": HINGE + '<unknown name="{0}"/>',
    "unknown attribute": HINGE + '<option unknown="{0}"/>',
    "unknown keyword": HINGE + '<option cone="{0}"/>',
    "unknown number": HINGE + '<option timestep="{0}"/>',
    "missing include": '<include file="{0}.xml"/>',
    "missing mesh": '<asset><mesh name="m" file="{0}.stl"/></asset>',
    "unknown plugin": '<extension><plugin plugin="{0}"/></extension>',
    "folder of meshes": '<compiler meshdir="{0}"/><asset><mesh file="missing.stl"/></asset>',
    "twice": HINGE + '<worldbody><body name="{0}"/><body name="{0}"/></worldbody>',
}
ENCODINGS = INPUTS["ENCODINGS"]
DECLARED = (
    "latin-1",
    "utf-16",
    "utf-7",
    "us-ascii",
    "rot13",
    "base64",
    "zlib",
    "idna",
    "hex",
    "unicode_escape",
    "EBCDIC-CP-US",
    "x" * 5000,
    "\u202e",
)
BYTES = {
    "a lone continuation byte": b"\x80",
    "a Latin-1 byte": b"caf\xe9",
    "an overlong slash": b"\xc0\xaf",
    "half a surrogate pair": b"\xed\xa0\x80",
    "a code point beyond all": b"\xf4\x90\x80\x80",
    "half a character": b"\xe2\x82",
    "a byte that never is": b"\xff\xfe",
    "a null": b"a\x00b",
    "C1 as a byte": b"\x9b2J",
}


def _escaped(text: str) -> str:
    """Text in an attribute as character references, which is how most control characters could stand there."""
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
    for what, encoding in ENCODINGS.items():
        yield Form(f"{what}", {"model.xml": text.encode(encoding, "replace")})
        declared = f'<?xml version="1.0" encoding="{encoding}"?>\n{text}'
        yield Form(f"{what}, declared", {"model.xml": declared.encode(encoding, "replace")})
    for encoding in DECLARED:
        yield Form(f"declared {encoding[:20]}", {"model.xml": f'<?xml version="1.0" encoding="{encoding}"?>\n{text}'})
    for what, content in BYTES.items():
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
        "nothing": b"",
        "a space": b" ",
        "one byte": b"<",
        "the declaration alone": b'<?xml version="1.0"?>',
        "zeros": bytes(4096),
        "all bytes": bytes(range(256)) * 16,
        "a Git LFS pointer": b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n",
        "HTML": b"<!DOCTYPE html><html><body>404</body></html>",
        "JSON": b'{"mujoco": {}}',
        "an ELF program": b"\x7fELF\x02\x01\x01" + bytes(100),
        "another root": b"<robot/>",
        "two roots": b"<mujoco/><mujoco/>",
        "an empty model": b"<mujoco/>",
        "only carriage returns": text.replace("\n", "\r").encode(),
        "a model in upper case": text.upper().encode(),
        "version 9.9": b'<?xml version="9.9"?><mujoco/>',
        "a namespace": b'<m:mujoco xmlns:m="urn:x"><m:option/></m:mujoco>',
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
