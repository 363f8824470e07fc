"""Calendar of each axis, and the checksums of its row."""

import sqlalchemy as sa
from alembic import op

from ballscrew.store.rows import checksum_of_values

revision = "0006"
down_revision = "0005"


def upgrade() -> None:
    """Add the column, and set the checksums of the rows that it changes."""
    op.add_column("setups", sa.Column("calendar", sa.JSON(none_as_null=True), nullable=True))
    connection = op.get_bind()
    table = sa.Table("setups", sa.MetaData(), autoload_with=connection)
    for row in connection.execute(sa.select(table)).mappings().all():
        values = {name: value for name, value in row.items() if name not in ("checksum", "calendar")}
        if checksum_of_values(values) != row["checksum"]:
            continue  # it is damaged, which its old checksum shows
        values["calendar"] = row["calendar"]
        statement = sa.update(table).where(table.c.axis_id == row["axis_id"])
        connection.execute(statement.values(checksum=checksum_of_values(values)))
