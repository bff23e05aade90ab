"""The published methods are there, are what their files say, and unknown names are answered with the known ones."""

import jax
import pytest

from jaxmodel.errors import InputError
from jaxmodel.register.method import IcpMethod, Strategy, ZhangFilter
from jaxmodel.register.methods import named, names, resolve

PUBLISHED = ["besl_mckay_1992", "chen_medioni_1991", "point_to_point", "thesis_2005", "thesis_2005_text"]


def test_every_published_method_is_there_and_loads() -> None:
    assert set(PUBLISHED) <= set(names())
    for name in names():
        assert isinstance(named(name), IcpMethod)
        assert resolve(name) == named(name)


def test_the_thesis_method() -> None:
    method = named("thesis_2005")
    assert [s.stack for s in method.strategies] == [1, 4, 3]
    assert [s.unique for s in method.strategies] == [False, True, True]
    assert [s.neighbourhood for s in method.strategies] == [4, 2, 1]
    assert [s.recluster for s in method.strategies] == [False, False, True]
    assert all(s.statistical_filter for s in method.strategies)
    assert method.border_filter and method.zhang is not None
    assert method.needs_fast_table and method.needs_exact_table


def test_the_text_differs_from_the_program_in_the_statistical_filter_alone() -> None:
    program, text = named("thesis_2005"), named("thesis_2005_text")
    assert [s.statistical_filter for s in text.strategies] == [True, False, False]
    described = {name: getattr(text, name) for name in IcpMethod.__dataclass_fields__ if name != "strategies"}
    assert described == {name: getattr(program, name) for name in described}
    for ours, theirs in zip(text.strategies, program.strategies, strict=True):
        assert Strategy(**{**vars(ours), "statistical_filter": True}) == theirs


def test_plain_methods_keep_every_pair() -> None:
    for name in ("besl_mckay_1992", "chen_medioni_1991", "point_to_point"):
        method = named(name)
        assert len(method.strategies) == 1
        assert method.zhang is None and not method.border_filter
        assert method.needs_fast_table and not method.needs_exact_table
    assert named("chen_medioni_1991").objective == "point_to_plane"
    assert named("besl_mckay_1992").max_distance is None


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(InputError, match=r"unknown method 'thesis_2004'.*besl_mckay_1992.*thesis_2005"):
        named("thesis_2004")
    with pytest.raises(InputError, match="unknown method"):
        resolve("../methods/thesis_2005")


def test_an_object_is_taken_as_it_is() -> None:
    method = IcpMethod(max_iterations=3)
    assert resolve(method) is method


@pytest.mark.parametrize(
    ("build", "sentence"),
    [
        (lambda: IcpMethod(strategies=()), "at least one strategy"),
        (lambda: IcpMethod(strategies=(Strategy(),) * 4), "at most three, not 4"),
        (lambda: IcpMethod(max_iterations=0), "max_iterations must be at least 1, not 0"),
        (lambda: IcpMethod(clusters=-1), "clusters must be at least 1, not -1"),
        (lambda: IcpMethod(max_distance=-0.5), "max_distance must be at least 0, not -0.5"),
        (lambda: IcpMethod(rotation_tolerance_deg=float("nan")), "rotation_tolerance_deg must be at least 0"),
        (lambda: IcpMethod(strategies=(Strategy(stack=9),)), r"candidates \(8\) must be at least the deepest stack"),
        (lambda: Strategy(stack=0), "stack must be at least 1, not 0"),
        (lambda: Strategy(slope_percent=-1.0), "slope_percent must be at least 0"),
        (lambda: Strategy(neighbourhood=-2.0), "neighbourhood must be at least 0"),
        (lambda: ZhangFilter(scale=-1.0), "scale must be at least 0"),
    ],
)
def test_impossible_options_are_refused(build, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        build()


def test_numbers_are_leaves_and_shapes_are_not() -> None:
    """Changing a float or a count leaves the tree's structure, so compiled programs are reused; a flag changes it."""
    structure = jax.tree.structure(IcpMethod(zhang=ZhangFilter(), max_distance=1.0))
    changed = IcpMethod(
        strategies=(Strategy(slope_percent=0.5),),
        zhang=ZhangFilter(2.0, 5.0),
        max_distance=0.3,
        max_iterations=7,
        rotation_tolerance_deg=1.0,
    )
    assert jax.tree.structure(changed) == structure
    assert jax.tree.structure(IcpMethod(zhang=ZhangFilter(), max_distance=1.0, border_filter=True)) != structure
