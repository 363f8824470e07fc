"""Alembic's environment: migrations run in the transaction of the connection that they are given."""

from alembic import context

from ballscrew.store import service_tables  # noqa: F401  whose tables belong to the metadata
from ballscrew.store.rows import Base

context.configure(
    connection=context.config.attributes["connection"], target_metadata=Base.metadata, render_as_batch=True
)
context.run_migrations()
