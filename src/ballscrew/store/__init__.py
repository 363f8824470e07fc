"""Store of a fleet: what was measured, estimated and decided, with raw files and provenance."""

from importlib.util import find_spec

from ballscrew.base.errors import InputError

if any(find_spec(name) is None for name in ("sqlalchemy", "alembic", "zstandard")):
    raise InputError(
        "the store needs SQLAlchemy, Alembic and zstandard; install them by "
        'python -m pip install "ballscrew[store]".'
    )
