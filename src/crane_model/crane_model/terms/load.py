"""What single recordings carry."""

from pydantic import Field

from crane_model.configuration import Schema


class Load(Schema):
    """`runs`, numbers of `Record.run`, that carry one load, and the `recordings` they come from."""

    runs: tuple[int, ...] = Field(min_length=1)
    recordings: tuple[str, ...] = ()
