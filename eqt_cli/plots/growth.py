"""Figure of a replay: growth of the prediction error with the horizon."""

from pathlib import Path

from eqt_cli.core.files import write_all
from eqt_cli.fitting.growth import Growth
from eqt_cli.plots.drawing import layout
from eqt_cli.plots.drawing.curves import band_look
from eqt_cli.plots.drawing.labels import in_words
from eqt_cli.plots.drawing.style import house_style, ink, line_style
from eqt_cli.plots.render import FORMATS, encode

NAME = "replay"


def save_growth(growth: Growth, folder: Path) -> list[Path]:
    """Draw and write the figure: rms, quantiles and noise, a panel for each part.

    Raises
    ------
    EqtError
        If a file cannot be written.
    """
    t = growth.horizons
    with house_style():
        drawing, panels = layout.sheet(
            "column", layout.rows_of(growth.parts, 1), (float(t[0]), float(t[-1])), "s"
        )
        for k, (part, unit) in enumerate(zip(growth.parts, growth.units, strict=True)):
            axes = panels[part]
            look = line_style(0)
            (rms,) = axes.plot(t, growth.rms[k], **look)
            band = axes.fill_between(t, growth.low[k], growth.high[k], **band_look(look["color"]))
            (noise,) = axes.plot(t, growth.noise[k], color=ink(), linestyle=(0, (1.2, 1)))
            axes.set_ylim(bottom=0.0)
            layout.name_scale(axes, in_words(part, unit))
        layout.add_legend(drawing, [rms, band, noise], ["rms", "10 % to 90 %", "noise alone, rms"])
        layout.add_letters(drawing)
        panels[growth.parts[-1]].set_xlabel(in_words("horizon", "s"))
        layout.add_remarks(drawing, [f"Errors of {growth.windows} windows of {growth.name}."])
        layout.freeze(drawing)
    title = f"{growth.name}: {NAME}"
    files = {
        folder / f"{NAME}.{format}": encode(drawing, format, title, "Errors of a prediction")
        for format in FORMATS
    }
    write_all(files, folder)
    return list(files)
