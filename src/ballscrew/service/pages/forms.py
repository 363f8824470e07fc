"""Forms of pages: what was entered, a sentence about what is wrong, and the answer after success."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, TypeVar
from urllib.parse import parse_qsl

from fastapi import Depends, Request
from fastapi.responses import RedirectResponse
from pydantic import BaseModel, ValidationError
from starlette.datastructures import ImmutableMultiDict

from ballscrew.base.errors import BallscrewError, InputError
from ballscrew.service.serving import UNPROCESSABLE, RefusedError

Body = TypeVar("Body", bound=BaseModel)

_MOST_FIELDS = 2000
_MOST_DIGITS = 10  # of the number of a row
_SENTENCES = {
    "string_too_short": "{field} must not be empty.",
    "too_short": "{field} must not be empty.",
    "string_too_long": "{field} must have {max_length} characters or fewer.",
    "too_long": "{field} must have {max_length} entries or fewer.",
    "float_parsing": "{field} must be a number.",
    "finite_number": "{field} must be a number.",
    "greater_than": "{field} must be greater than {gt:g}.",
    "greater_than_equal": "{field} must be {ge:g} or greater.",
    "less_than_equal": "{field} must be {le:g} or less.",
    "date_parsing": "{field} must be dates such as 2026-12-25.",
    "value_error": "{field}: {error}.",
}


@dataclass(frozen=True)
class Outcome:
    """What became of a form, for the section of the page that contains it.

    Parameters
    ----------
    section : str
        Name of the section.
    message : str
        What is wrong; empty where nothing is.
    values : mapping
        What was entered, which the form shows again.
    status : int
        HTTP status of the page.
    result : object
        What was computed from it, such as a preview.
    """

    section: str = ""
    message: str = ""
    values: Mapping[str, Any] = field(default_factory=dict)
    status: int = 200
    result: Any = None

    def value(self, section: str, name: str, default: str = "") -> Any:
        """What was entered in a field of a section, or else a default."""
        if section != self.section:
            return default
        return self.values.get(name, default)


async def read_form(request: Request) -> ImmutableMultiDict[str, str]:
    """Fields of a form that was posted, with ends of lines as one character.

    Raises
    ------
    RefusedError
        422 if there are too many.
    """
    text = (await request.body()).decode("utf-8", "replace")
    try:
        pairs = parse_qsl(text, keep_blank_values=True, max_num_fields=_MOST_FIELDS)
    except ValueError:
        raise RefusedError(UNPROCESSABLE, "the form has too many fields.") from None
    return ImmutableMultiDict([(name, value.replace("\r\n", "\n")) for name, value in pairs])


PostedForm = Annotated[ImmutableMultiDict[str, str], Depends(read_form)]


def entered(model: type[Body], labels: Mapping[str, str], **values: Any) -> Body:
    """Body of a request of the API from the fields of a form.

    Parameters
    ----------
    model : type
        Of the body.
    labels : mapping of str to str
        Name on the page of each field, for messages.
    **values
        Of the fields.

    Returns
    -------
    BaseModel
        The body.

    Raises
    ------
    InputError
        With one sentence about the first field that is wrong.
    """
    try:
        return model(**values)
    except ValidationError as error:
        first = error.errors()[0]
        name = next(part for part in reversed(first["loc"]) if isinstance(part, str))
        template = _SENTENCES.get(first["type"], "{field} is not valid.")
        sentence = template.format(field=labels.get(name, name), **first.get("ctx", {}))
        raise InputError(sentence) from None


def entered_number(form: Mapping[str, Any], name: str) -> int:
    """Number of a row that a form states.

    Raises
    ------
    InputError
        If it is none.
    """
    text = str(form.get(name, ""))
    if not (text.isascii() and text.isdecimal() and len(text) < _MOST_DIGITS):
        raise InputError(f"The form states no {name}.")
    return int(text)


def refusal(section: str, error: BallscrewError, values: Mapping[str, Any]) -> Outcome:
    """Outcome of a form whose content was refused."""
    status = UNPROCESSABLE
    if isinstance(error, RefusedError):
        status = error.status
    return Outcome(section, str(error), values, status)


def go_to(address: str, done: str) -> RedirectResponse:
    """Answer after success: the page again, which then says what was done."""
    path, _, fragment = address.partition("#")
    separator = "&" if "?" in path else "?"
    place = f"#{fragment}" if fragment else ""
    return RedirectResponse(f"{path}{separator}done={done}{place}", 303)


def time_of(form: Mapping[str, Any]) -> str:
    """Time that was entered; the browser adds the offset of its zone, without which it is UTC."""
    at, offset = str(form.get("at", "")).strip(), str(form.get("offset", ""))
    return at + offset if at and offset else at
