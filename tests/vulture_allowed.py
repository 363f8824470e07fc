"""Names that vulture finds unused and that are used: by Python, a library, JSON, docs or benchmarks."""

# Python, notebooks and pytest
_repr_html_
__getattr__
__dir__
__test__
# pydantic, uvicorn and tempfile read these
model_config
handle_exit
force_exit
tempdir
# a column that the sender of messages will write
sent_at
# pages in another language
# typer registers these commands
_main
simulate_multi_level_mass
simulate_run_to_failure
list_all
disable
# fields that dataclasses.asdict or a loop over names writes to a document
moving_mass_kg
viscous_N_s_per_m
offset_N
reference_at
table_share
working_days
residual_ratio
start_C
end_C
# numba reads it
_cache
# emcee's sampler reads it
random_state
# benchmarks and tests of the truth
alarms
# drawings of results, by their names
draw_response
draw_mode
draw_smallest_loss
draw_information
draw_quality
# public functions that the documentation describes
preload_at_frequency
frequency_from_preload
nut_deflection
tangent_ratio
nut_rigidity_under_load
wrong_position
wrong_sample_rate
oil_film
bearing_change
equivalent_preload_ratio
rod_frequency
read_table
# readers by their entry points, forecasters by name
readers
Hdf5Reader
MatReader
NpzReader
ParquetReader
TextReader
ResponseReader
ProfileReader
TraceReader
TwinCatReader
TdmsReader
Mdf4Reader
NamedTemporaryFile
__del__
WavReader
UffReader
LvmReader
ExponentialFilter
WienerProcess
friction_ahead
bearing_change
equivalent_preload_ratio
to_xarray  # public
from_arrays  # public

# Handlers of the XML parser
buffer_text
StartDoctypeDeclHandler
StartElementHandler
EndElementHandler
CharacterDataHandler

# Parts of typer that are replaced
collect_usage_pieces
display_type_rich

# Columns that show, export and audits read, SQLAlchemy and Alembic
show
begun_at
raised_at
added_at
received_at
down_revision
type_annotation_map
_set_checksum
_wait_for_writers
_begin

# Whole histories, for benchmarks; an import that reading needs; how an assessment was made
new_runs
health_state
compute_limits
hdf5
chart_of
simulate_healthy

# What smtplib, http.client and pydantic look up
_get_socket
default_port
_checked_url
_check_zone
# logging and SQLAlchemy call these
handleError
_is_stored_in_rows
# smtplib reads these
ehlo_resp
helo_resp
esmtp_features
does_esmtp
