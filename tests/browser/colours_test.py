"""The page's colours as colour-blind eyes see them, computed from its style sheet; no browser is needed.

usage: colours_test.py SOURCE_FOLDER

Protanopia, deuteranopia and tritanopia by Machado, Oliveira and Fernandes (2009), severity 1, on linear RGB; differences by
CIEDE2000 (Sharma, Wu and Dalal, 2005).
"""
import itertools
import math
import pathlib
import re
import sys
import unittest

SIGHT = {
    "full": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "protanopia": ((0.152286, 1.052583, -0.204868), (0.114503, 0.786281, 0.099216), (-0.003882, -0.048116, 1.051998)),
    "deuteranopia": ((0.367322, 0.860646, -0.227968), (0.280085, 0.672501, 0.047413), (-0.011820, 0.042940, 0.968881)),
    "tritanopia": ((1.255528, -0.076749, -0.178779), (-0.078411, 0.930809, 0.147602), (0.004733, 0.691367, 0.303900)),
}
GREY = ((0.2126, 0.7152, 0.0722),) * 3  # a black and white printer, for which the page is light
# What only its colour tells apart where it is drawn: 20 is well beyond what a glance needs (about 2.3 is just noticeable).
ALONE = 20
# What a sign, a dash or a word tells apart as well: the colours may come nearer, and still differ at a look.
WITH_A_SECOND_CUE = 8
NO_VERDICT = "#8b949e"  # of a valve's mark in a report, beside the verdicts' own
TOGETHER = [
    # Solid lines in one plot; the extended simulation and its residual are dashed.
    (ALONE, ("measured", "simulated")),
    (WITH_A_SECOND_CUE, ("measured", "simulated", "extended")),
    (WITH_A_SECOND_CUE, ("residual", "extended_residual")),
    # A circle, a triangle and a square stand with the verdicts.
    (WITH_A_SECOND_CUE, ("good", "malfunctioned", "severe")),
]


def palettes(css):
    """The variables of :root, light and dark; dark ones stand over the light."""
    blocks = re.findall(r":root \{(.*?)\n\s*\}", css, re.S)
    light, dark = (dict(re.findall(r"--([a-z_]+): (#[0-9a-f]{6})", block)) for block in blocks[:2])
    return {"light": light, "dark": {**light, **dark}}


def linear(colour):
    parts = [int(colour[i:i + 2], 16) / 255 for i in (1, 3, 5)]
    return [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]


def seen(colour, sight):
    rows = GREY if sight == "grey" else SIGHT[sight]
    return [min(1, max(0, sum(k * c for k, c in zip(row, linear(colour))))) for row in rows]


def luminance(colour):
    return sum(k * c for k, c in zip((0.2126, 0.7152, 0.0722), linear(colour)))


def contrast(a, b):
    low, high = sorted((luminance(a), luminance(b)))
    return (high + 0.05) / (low + 0.05)


def lab(rgb):
    rows = ((0.4124564, 0.3575761, 0.1804375), (0.2126729, 0.7151522, 0.0721750), (0.0193339, 0.1191920, 0.9503041))
    xyz = [sum(k * c for k, c in zip(row, rgb)) / white for row, white in zip(rows, (0.95047, 1, 1.08883))]
    x, y, z = (v ** (1 / 3) if v > (6 / 29) ** 3 else v / (3 * (6 / 29) ** 2) + 4 / 29 for v in xyz)
    return 116 * y - 16, 500 * (x - y), 200 * (y - z)


def difference(first, second):
    """CIEDE2000 of two colours in Lab."""
    (l1, a1, b1), (l2, a2, b2) = first, second
    mean_c = (math.hypot(a1, b1) + math.hypot(a2, b2)) / 2
    g = 0.5 * (1 - math.sqrt(mean_c ** 7 / (mean_c ** 7 + 25 ** 7)))
    a1, a2 = a1 * (1 + g), a2 * (1 + g)
    c1, c2 = math.hypot(a1, b1), math.hypot(a2, b2)
    h1, h2 = (math.degrees(math.atan2(b, a)) % 360 for a, b in ((a1, b1), (a2, b2)))
    turn = (h2 - h1 + 180) % 360 - 180 if c1 * c2 else 0
    dl, dc, dh = l2 - l1, c2 - c1, 2 * math.sqrt(c1 * c2) * math.sin(math.radians(turn / 2))
    l, c = (l1 + l2) / 2, (c1 + c2) / 2
    if not c1 * c2:
        h = h1 + h2
    else:
        h = (h1 + h2) / 2 if abs(h1 - h2) <= 180 else ((h1 + h2 + 360) / 2) % 360
    t = (1 - 0.17 * math.cos(math.radians(h - 30)) + 0.24 * math.cos(math.radians(2 * h)) + 0.32 * math.cos(math.radians(3 * h + 6))
         - 0.20 * math.cos(math.radians(4 * h - 63)))
    s_l = 1 + 0.015 * (l - 50) ** 2 / math.sqrt(20 + (l - 50) ** 2)
    s_c, s_h = 1 + 0.045 * c, 1 + 0.015 * c * t
    r = -2 * math.sqrt(c ** 7 / (c ** 7 + 25 ** 7)) * math.sin(math.radians(60 * math.exp(-(((h - 275) / 25) ** 2))))
    return math.sqrt((dl / s_l) ** 2 + (dc / s_c) ** 2 + (dh / s_h) ** 2 + r * (dc / s_c) * (dh / s_h))


def apart(a, b, sight):
    return difference(lab(seen(a, sight)), lab(seen(b, sight)))


class Colours(unittest.TestCase):
    def test_the_formula_gives_the_differences_of_its_publication(self):
        # Pairs 1, 7, 17 and 25 of Sharma, Wu and Dalal's table.
        for first, second, published in (((50, 2.6772, -79.7751), (50, 0, -82.7485), 2.0425), ((50, 0, 0), (50, -1, 2), 2.3669),
                                         ((50, 2.5, 0), (73, 25, -18), 27.1492), ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644)):
            self.assertAlmostEqual(difference(first, second), published, places=4)

    def test_red_and_green_of_one_lightness_fall_together_for_those_who_do_not_see_them(self):
        red, green = "#b06a5a", "#808040"
        self.assertLess(apart(red, green, "deuteranopia"), 0.6 * apart(red, green, "full"))

    def test_colours_that_stand_together_are_told_apart_by_every_sight(self):
        for theme, palette in palettes(CSS.read_text(encoding="utf-8")).items():
            for least, names in TOGETHER:
                for (a, b), sight in itertools.product(itertools.combinations(names, 2), [*SIGHT, *(["grey"] if least == ALONE and theme == "light" else [])]):
                    with self.subTest(theme=theme, pair=(a, b), sight=sight):
                        self.assertGreater(apart(palette[a], palette[b], sight), least)

    def test_every_colour_that_is_drawn_stands_out_from_its_background(self):
        # 3 is what WCAG 2.2 (1.4.11) asks of graphics.
        for theme, palette in palettes(CSS.read_text(encoding="utf-8")).items():
            for name in {name for _, names in TOGETHER for name in names} | {"input", "link", "soft"}:
                with self.subTest(theme=theme, colour=name):
                    self.assertGreater(contrast(palette[name], palette["back"]), 3)

    def test_reports_draw_in_the_colours_of_the_page(self):
        light = set(palettes(CSS.read_text(encoding="utf-8"))["light"].values())
        for source in ("svg_plot.cpp", "markup.cpp"):
            used = set(re.findall(r"#[0-9a-f]{6}", (FOLDER / "server/report" / source).read_text(encoding="utf-8")))
            self.assertEqual(used - light - {NO_VERDICT}, set(), source)


if __name__ == "__main__":
    FOLDER = pathlib.Path(sys.argv[1])
    CSS = FOLDER / "server/web/page.css"
    unittest.main(argv=sys.argv[:1], verbosity=2)
