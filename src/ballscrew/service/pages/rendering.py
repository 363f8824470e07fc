"""Rendering of pages: templates, languages, numbers and times by locale, headers, and static files."""

from __future__ import annotations

import gettext
import hashlib
import re
from collections.abc import Mapping
from datetime import UTC, date, datetime
from decimal import Decimal
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any
from urllib.parse import parse_qsl, quote, urlencode

from babel.dates import format_date, format_datetime
from babel.numbers import format_decimal
from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from ballscrew._version import __version__
from ballscrew.base.reasons import ReaderLanguage, page_template, translated
from ballscrew.base.words import interval_words
from ballscrew.monitoring.epochs import moment
from ballscrew.report.blocks import short_name
from ballscrew.report.canvas import STATE_SIGNS
from ballscrew.service.access import Caller
from ballscrew.service.serving import RefusedError, service_of

LANGUAGES = ("en", "de")

_COOKIE = "ballscrew_language"
_YEAR = 365 * 86400  # s
_MOST_CACHED = 20_000  # numbers and times of a fleet
_MOST_SENTENCES, _LONGEST_CACHED = 2000, 1000  # sentences in memory, and characters of one
_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' "
    "data:; connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'",
    "Cache-Control": "no-store",
    "Vary": "Accept-Language, Cookie",
    "Referrer-Policy": "same-origin",  # without a referrer, a browser sends a form from the origin "null"
}
_TYPES = {".js": "text/javascript", ".css": "text/css", ".txt": "text/plain", ".svg": "image/svg+xml"}
_UNKNOWN_SIGN = "○"
MINUS = "\N{MINUS SIGN}"
"""Sign of a negative number on pages; files for computers have a hyphen."""

_FINDINGS = re.compile("; (?=for: |against: |unclear: )")
_DAY = re.compile(r"\d{4}-\d\d-\d\d")
_MOMENT = re.compile(r"\d{4}-\d\d-\d\d(?:T[\d:.]+(?:Z|[+-]\d\d:\d\d)| \d\d:\d\d UTC)")
_NUMBER = re.compile(r"[±+-]?\d+(?:\.\d+)?(?: %)?")
_DAYS = {"en": "d MMM yyyy", "de": "dd.MM.yyyy"}  # as browsers in Europe have them

router = APIRouter(include_in_schema=False)


def render(request: Request, template: str, status: int = 200, **context: Any) -> HTMLResponse:
    """Answer with a page.

    Parameters
    ----------
    request : Request
        Its headers and ``?lang=`` decide the language.
    template : str
        Name of the template.
    status : int
        HTTP status.
    **context
        Variables of the template.

    Returns
    -------
    HTMLResponse
        The page, with the headers of all pages.
    """
    language = language_of(request)
    caller: Caller | None = getattr(request.state, "caller", None)  # none on pages for all
    token = "" if caller is None else caller.form_token
    text = (
        environment_of(language)
        .get_template(template)
        .render(
            path=request.scope["path"],
            query=_query_of(request),
            language=language,
            switches=_switches(request),
            simulated=service_of(request).store.folder.is_simulated(),
            may=lambda role: caller is not None and caller.may(role),
            user=caller.name if token and caller is not None else "",
            form_token=token,
            form_field=_form_field(token),
            **context,
        )
    )
    answer = HTMLResponse(text, status, headers=_HEADERS)
    if request.query_params.get("lang") in LANGUAGES:
        answer.set_cookie(_COOKIE, language, max_age=_YEAR, samesite="strict", httponly=True)
    return answer


def _form_field(token: str) -> Markup:
    """Field of each form that changes something, by which the guard knows the page."""
    if not token:
        return Markup()
    return Markup('<input type="hidden" name="csrf" value="{}">').format(token)


def _query_of(request: Request) -> str:
    return str(request.scope["query_string"].decode("latin-1"))


def language_of(request: Request) -> str:
    """Language of a request: by ``?lang=``, else its cookie, else the first known one of its header."""
    for stated in (request.query_params.get("lang"), request.cookies.get(_COOKIE)):
        if stated in LANGUAGES:
            return str(stated)
    for part in request.headers.get("accept-language", "").split(","):
        language = part.split(";")[0].strip()[:2].lower()
        if language in LANGUAGES:
            return language
    return LANGUAGES[0]


def _switches(request: Request) -> dict[str, str]:
    """Address of the same page in each language."""
    present = parse_qsl(_query_of(request), keep_blank_values=True)
    query = [(name, value) for name, value in present if name != "lang"]
    return {each: "?" + urlencode([*query, ("lang", each)]) for each in LANGUAGES}


@cache
def translations(language: str) -> gettext.NullTranslations:
    """Catalogue of a language; English has none."""
    folder = files("ballscrew") / "locale"
    return gettext.translation("ballscrew", str(folder), [language], fallback=True)


@cache
def environment_of(language: str) -> Environment:
    """Templates with the texts, numbers and times of a language."""
    environment = Environment(
        loader=PackageLoader("ballscrew.service.pages"),
        extensions=["jinja2.ext.i18n"],
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.install_gettext_translations(translations(language), newstyle=True)  # type: ignore[attr-defined]
    environment.filters.update(
        number=lambda value, decimals=2: format_number(value, decimals, language),
        percent_of=lambda interval: format_percent(interval, language),
        moment=lambda text: format_moment(text, language),
        utc=lambda seconds: datetime.fromtimestamp(seconds, UTC).isoformat(timespec="seconds"),
        url=lambda text: quote(str(text), safe=""),
        findings=_FINDINGS.split,
        sentence=lambda text, part=False: page_sentence(text, language, part=part),
        short=short_name,
    )
    environment.globals.update(version=__version__, asset=asset_url, sign=sign_of, languages=LANGUAGES)
    return environment


def sign_of(state: str) -> str:
    """Sign of a state, which distinguishes it without colour."""
    return STATE_SIGNS.get(state, _UNKNOWN_SIGN)


def format_number(value: float | None, decimals: int, language: str) -> str:
    """Number with a fixed number of decimals, rounded as the command line does; a dash for None."""
    return "–" if value is None else _localized(f"{value:.{decimals}f}", decimals, language)


@lru_cache(maxsize=_MOST_CACHED)
def _localized(text: str, decimals: int, language: str) -> str:
    """A rounded number as a language has it."""
    pattern = "#,##0" + ("." + "0" * decimals if decimals else "")
    return format_decimal(Decimal(text), pattern, locale=language).replace("-", MINUS)


def significant(value: float, digits: int, language: str) -> str:
    """Number with significant digits."""
    return format_decimal(value, "@" * digits, locale=language).replace("-", MINUS)


def address_of(axis: str, page: str = "") -> str:
    """Address of an axis, or of one of its pages."""
    return f"/axes/{quote(axis, safe='')}" + (f"/{page}" if page else "")


def format_percent(interval: list[float] | None, language: str) -> str:
    """P/P₀ in percent with its interval, ``88 (83 to 94) %``, as the command line and reports have it."""
    gettext = translations(language).gettext
    return interval_words(interval, lambda value, decimals: format_number(value, decimals, language), gettext)


@lru_cache(maxsize=_MOST_CACHED)
def format_moment(text: str | None, language: str) -> str:
    """Time in UTC, to the minute; a dash for None. The browser replaces it by local time."""
    if text is None:
        return "–"
    pattern = f"{_DAYS[language]}, HH:mm"
    return format_datetime(moment(text, "a time"), pattern, tzinfo=UTC, locale=language) + " UTC"


def page_sentence(text: str, language: str, *, part: bool = False) -> str:
    """A reason, or an action, in a language, with its numbers and times as all those of the pages."""
    find = _sentence if len(text) <= _LONGEST_CACHED else _sentence.__wrapped__
    return find(text, language, part)


@lru_cache(maxsize=_MOST_SENTENCES)
def _sentence(text: str, language: str, part: bool) -> str:
    gettext = translations(language).gettext
    reader = ReaderLanguage(
        lambda template: gettext(page_template(template)), lambda value: _shown(value, language)
    )
    return translated(text, reader, part=part)


def _shown(value: str, language: str) -> str:
    """A number, a day or a time of a sentence as all those of the pages; another text as it is."""
    if _DAY.fullmatch(value):
        return format_date(date.fromisoformat(value), _DAYS[language], locale=language)
    if _MOMENT.fullmatch(value):
        return format_moment(value.replace(" UTC", "+00:00"), language)
    if not _NUMBER.fullmatch(value):
        return value
    value = value.replace("-", MINUS)
    if language == "de":
        value = value.replace(".", ",")
    return value


@cache
def _assets() -> Mapping[str, tuple[bytes, str, str]]:
    """Content, digest and type of each static file."""
    found = {}
    for file in (files("ballscrew.service.pages") / "static").iterdir():
        content = file.read_bytes()
        suffix = "." + file.name.rpartition(".")[2]
        found[file.name] = content, hashlib.sha256(content).hexdigest()[:12], _TYPES[suffix]
    return found


def asset_url(name: str) -> str:
    """Address of a static file, which changes with its content."""
    return f"/static/{_assets()[name][1]}/{name}"


@router.get("/static/{digest}/{name}")
def send_asset(digest: str, name: str) -> Response:
    """A static file."""
    if name not in _assets():
        raise RefusedError(404, "there is no such file.")
    content, current, kind = _assets()[name]
    cached = "public, max-age=31536000, immutable" if digest == current else "no-store"
    headers = {"Cache-Control": cached, "ETag": f'"{current}"'}
    return Response(content, media_type=f"{kind}; charset=utf-8", headers=headers)
