"""Methods by name: a published method is a YAML file in configs/methods with its citation on top."""

from jaxmodel.errors import InputError
from jaxmodel.register.method import IcpMethod


def names() -> list[str]:
    """The methods that can be named."""
    from jaxmodel.io.strict_yaml import config_files

    return sorted(path.stem for path in (config_files() / "methods").glob("*.yaml"))


def named(name: str) -> IcpMethod:
    """The method of ``configs/methods/NAME.yaml``; ``InputError`` with the known names where there is none."""
    from jaxmodel.io.strict_yaml import config_files, read_yaml, structure

    known = names()
    if name not in known:
        raise InputError(f"unknown method {name!r}: expected one of {', '.join(known)}")
    path = config_files() / "methods" / f"{name}.yaml"
    return structure(read_yaml(path), IcpMethod, str(path))


def resolve(method: str | IcpMethod) -> IcpMethod:
    """A method given by name or as an object."""
    return named(method) if isinstance(method, str) else method
