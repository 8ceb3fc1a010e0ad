from dataclasses import dataclass
def write_report(definition, runs, out):
    raise SystemExit(0)
