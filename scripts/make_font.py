"""Makes the font of text on images, mjrun/rendering/fonts/Inter.ttf, from the published variable font.

    pip download --no-deps fontpkg-inter==4.1.post1 && unzip fontpkg_inter-*.whl
    python scripts/make_font.py 'fontpkg_inter/files/Inter[opsz,wght].ttf'

It keeps the regular weight at the size of small text, every character with a code point of its own, and one shape of
each: digits and signs are those of equal width (tnum). The same font gives the same bytes.
"""

import hashlib
import sys
from pathlib import Path

from fontTools import subset
from fontTools.ttLib import TTFont
from fontTools.varLib import instancer

SOURCE = "29160a80ff49ddcab2c97711247e08b1fab27a484a329ce8b813d820dc559031"  # SHA-256
TARGET = Path(__file__).parents[1] / "mjrun" / "rendering" / "fonts" / "Inter.ttf"
WEIGHT, OPTICAL_SIZE = 400, 14
PRIVATE_USE = range(0xE000, 0xF900)


def make_font(source: Path, target: Path) -> None:
    """Writes the font for text on images.

    Raises:
      SystemExit: `source` is another font than the one that this was written for.
    """
    if hashlib.sha256(source.read_bytes()).hexdigest() != SOURCE:
        sys.exit(f"{source} is not Inter 4.001 of fontpkg-inter 4.1.post1")
    font = TTFont(source, recalcTimestamp=False)
    instancer.instantiateVariableFont(font, {"wght": WEIGHT, "opsz": OPTICAL_SIZE}, inplace=True)

    tabular = _substitutions(font, "tnum")
    for table in font["cmap"].tables:
        table.cmap = {code: tabular.get(glyph, glyph) for code, glyph in table.cmap.items()}

    options = subset.Options(notdef_outline=True, hinting=False, name_IDs=["*"])
    options.drop_tables += ["GSUB", "GPOS", "GDEF", "STAT"]
    subsetter = subset.Subsetter(options)
    subsetter.populate(unicodes=[code for code in font.getBestCmap() or {} if code not in PRIVATE_USE])
    subsetter.subset(font)
    font.save(target)


def _substitutions(font: TTFont, feature: str) -> dict[str, str]:
    """Returns the glyphs that a feature substitutes for others."""
    table = font["GSUB"].table
    records = [record for record in table.FeatureList.FeatureRecord if record.FeatureTag == feature]
    indices = sorted({index for record in records for index in record.Feature.LookupListIndex})

    pairs: dict[str, str] = {}
    for subtable in (subtable for index in indices for subtable in table.LookupList.Lookup[index].SubTable):
        pairs |= subtable.mapping
    return pairs


if __name__ == "__main__":
    make_font(Path(sys.argv[1]), TARGET)
