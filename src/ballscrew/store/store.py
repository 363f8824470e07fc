"""A store as an object: every command ``ballscrew store`` is a method."""

from __future__ import annotations

from ballscrew.store import (
    adding,
    assessing,
    changing,
    checking,
    copying,
    fleet,
    migrating,
    reading,
    reporting,
    reprocessing,
    retention,
    showing,
)
from ballscrew.store.opened import OpenStore


class Store(OpenStore):
    """Store of a fleet: runs, results, raw files, models, events and states of its axes.

    Parameters
    ----------
    path : path-like
        Data folder of the store.

    Raises
    ------
    InputError
        If the folder contains no store, or one of another schema.

    Examples
    --------
    >>> store = ballscrew.Store("plant")  # doctest: +SKIP
    >>> store.add("run.toml")  # doctest: +SKIP
    >>> store.monitor("X axis of mill 4").monitored.state.state  # doctest: +SKIP
    """

    init = staticmethod(migrating.create_store)
    add = adding.add
    list = reading.list_axes
    show = showing.show
    monitor = assessing.monitor_axis
    correct = changing.correct_run
    choose_model = changing.choose_model
    exclude = changing.exclude
    archive = copying.archive
    export = copying.export
    backup = copying.backup
    restore = staticmethod(copying.restore)
    verify = staticmethod(checking.verify)
    gc = checking.gc
    retain = retention.retain
    migrate = staticmethod(migrating.migrate)
    report = reporting.report
    reprocess = reprocessing.reprocess
    simulate_fleet = fleet.simulate_fleet
