"""Alembic's environment: migrations run in the transaction of the connection that they are given."""

from alembic import context

from ballscrew.store.tables import Base

context.configure(
    connection=context.config.attributes["connection"], target_metadata=Base.metadata, render_as_batch=True
)
context.run_migrations()
