"""Table of the switches to another method where runs have no raw files."""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"


def upgrade() -> None:
    """Create it."""
    op.create_table(
        "method_changes",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("axis_id", sa.Integer(), nullable=False),
        sa.Column("old_method_id", sa.Integer(), nullable=False),
        sa.Column("new_method_id", sa.Integer(), nullable=False),
        sa.Column("step", sa.Float(precision=53), nullable=False),
        sa.Column("step_uncertainty", sa.Float(precision=53), nullable=False),
        sa.Column("runs", sa.Integer(), nullable=False),
        sa.Column("changed_at", sa.Text(), nullable=False),
        sa.Column("checksum", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(["axis_id"], ["axes.id"], name=op.f("fk_method_changes_axis_id")),
        sa.ForeignKeyConstraint(
            ["old_method_id"], ["methods.id"], name=op.f("fk_method_changes_old_method_id")
        ),
        sa.ForeignKeyConstraint(
            ["new_method_id"], ["methods.id"], name=op.f("fk_method_changes_new_method_id")
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_method_changes")),
        sa.UniqueConstraint("axis_id", "new_method_id", name=op.f("uq_method_changes_axis_id_new_method_id")),
    )
