"""A plant cut into parts, analysed one after the other in this process, and put together: what a cluster does."""

from __future__ import annotations

import pickle
from dataclasses import replace

from backlash_cli.api import scan_part
from backlash_cli.engines.combine import combine
from backlash_cli.loaders import ReadOptions
from backlash_cli.loaders.options import is_age
from backlash_cli.loaders.parts import alone, cut_parts, make_plan, sources_of, survey_all
from backlash_cli.scanning import ScanOptions

QUICK = ScanOptions(confirm=False)


def plan_of(inputs, reading=None, loops=None):
    """Survey the files and settle the loops."""
    reading = reading or ReadOptions()
    sources = sources_of(inputs)
    end = reading.since is not None and is_age(reading.since)
    surveys = survey_all([alone(s) for s in sources], reading, end=end)
    return make_plan(inputs, sources, pickle.loads(pickle.dumps(surveys)), loops=loops, reading=reading)


def in_parts(inputs, reading=None, loops=None, workers=2, single=True):
    """The result of a plant that was cut into parts of one loop each, or as for so many workers."""
    plan = plan_of(inputs, reading, loops)
    parts = [plan.part([name]) for name in plan.loops] if single else cut_parts(plan, workers)
    sent = [replace(part) for part in pickle.loads(pickle.dumps(parts))]
    return combine(plan, [scan_part(part, QUICK) for part in sent])
