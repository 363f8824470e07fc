"""Service of a fleet: receives runs, analyses them, assesses the axes, and answers over HTTP."""

from importlib.util import find_spec

from ballscrew.base.errors import InputError

if any(find_spec(name) is None for name in ("fastapi", "uvicorn", "jinja2", "pydantic_settings")):
    raise InputError(
        "the service needs FastAPI, uvicorn, Jinja2 and pydantic-settings; install them by "
        'python -m pip install "ballscrew[server]".'
    )
