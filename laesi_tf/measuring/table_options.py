"""How the tables of a folder of results are written: kept until a command says otherwise."""

from dataclasses import dataclass, field
from typing import Any

from laesi_tf.measuring.sample_names import SampleNames
from laesi_tf.reporting.record_tables import CSV_FORMATS

STANDARD_CSV = next(iter(CSV_FORMATS))


@dataclass(frozen=True)
class TableOptions:
    """What the commands of a folder named last."""

    csv: str = STANDARD_CSV
    """A dialect of `CSV_FORMATS`."""
    names: SampleNames = field(default_factory=SampleNames)

    def to_values(self) -> dict[str, Any]:
        """Return the options as JSON values."""
        return {"csv": self.csv, "names": self.names.to_values()}

    def describe(self, *, without_csv: bool, without_names: bool) -> list[str]:
        """Return lines that say what holds for a command that does not name a dialect, or a list."""
        held, lines = [], []
        if without_csv and self.csv != STANDARD_CSV:
            held.append(f"--csv {self.csv}")
        if without_names and self.names.rows:
            held.append(f"--names {self.names.source}")
        if held:
            lines.append(f"as in earlier commands: {', '.join(held)}")
        if without_names and self.names.has_changed():
            lines.append(f"{self.names.source} has changed since; name it with --names to read it again")
        return lines

    @classmethod
    def from_values(cls, values: dict[str, Any]) -> "TableOptions":
        """Return the options of `to_values`; the defaults where the values are damaged or missing."""
        try:
            names = SampleNames.from_values(values["names"])
            return cls(values["csv"], names) if values["csv"] in CSV_FORMATS else cls(names=names)
        except (KeyError, TypeError, ValueError):
            return cls()
