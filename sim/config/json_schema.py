"""JSON Schema of configuration files, for editors that complete and check TOML."""

from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core.core_schema import IsInstanceSchema

DIALECT = "https://json-schema.org/draft/2020-12/schema"


class _FileSchema(GenerateJsonSchema):
    """Describe objects that a file names by text, such as covariance functions, as text."""

    def is_instance_schema(self, schema: IsInstanceSchema) -> dict[str, Any]:  # noqa: ARG002
        return {"type": "string"}


def json_schema(model: type[BaseModel], title: str) -> dict[str, Any]:
    """Return the JSON Schema of a configuration: keys with type, limits, default and meaning.

    Parameters
    ----------
    model : type of pydantic.BaseModel
        Configuration, such as `MissionConfig`.
    title : str
        Title of the schema.

    Returns
    -------
    dict
        JSON Schema, draft 2020-12. Checks across several keys are not in it.

    Examples
    --------
    >>> from sim.config.mission import ScoreConfig
    >>> json_schema(ScoreConfig, "score")["properties"]["require"]["enum"]
    ['class-1', 'class-2', 'class-3']
    """
    schema = model.model_json_schema(schema_generator=_FileSchema)
    return {"$schema": DIALECT, **schema, "title": title}
