"""Finding photos: subfolders, patterns, links, odd names, and what is passed over."""

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from laesi_tf.common.errors import InputError
from laesi_tf.data.photo_pages import PhotoPage
from laesi_tf.data.photo_search import FoundPhoto, find_photos
from laesi_tf.measuring.photo_tasks import _name_overlay


def touch(*paths: Path) -> None:
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"x")


def found(folder: Path, *arguments: object, recursive: bool = False) -> list[str]:
    search = find_photos([str(argument) for argument in arguments or [folder]], recursive=recursive)
    return [photo.path.relative_to(folder).as_posix() for photo in search.photos]


def test_subfolders_are_searched_on_request_and_named_otherwise(tmp_path: Path) -> None:
    touch(*(tmp_path / name for name in ("b.jpg", "A/c.JPG", "A/deep/d.hif", "e.tif", "f/notes.txt")))
    assert found(tmp_path) == ["b.jpg", "e.tif"]
    assert "2 subfolders (--recursive" in find_photos([str(tmp_path)]).describe_passed_over()
    assert found(tmp_path, recursive=True) == ["b.jpg", "e.tif", "A/c.JPG", "A/deep/d.hif"]
    search = find_photos([str(tmp_path)], recursive=True)
    assert [photo.inside for photo in search.photos] == ["", "", "A/", "A/deep/"]
    assert search.describe_passed_over() == "1 file that is no photo (1 .txt)"


def test_what_is_passed_over_is_one_line_and_hidden_files_are_silent(tmp_path: Path) -> None:
    hidden = (".DS_Store", "._a.jpg", "Thumbs.db", "desktop.ini", "areas.csv", "a.overlay.jpg", ".git/x.jpg")
    touch(tmp_path / "a.jpg", *(tmp_path / name for name in hidden))
    assert found(tmp_path) == ["a.jpg"] and not find_photos([str(tmp_path)]).describe_passed_over()
    touch(*(tmp_path / f"{number}.xmp" for number in range(3000)), tmp_path / "README")
    text = find_photos([str(tmp_path)]).describe_passed_over()
    assert text == "3001 files that are no photo (3000 .xmp, 1 without suffix)"


def test_loops_of_links_end_and_each_folder_is_searched_once(tmp_path: Path) -> None:
    touch(tmp_path / "a" / "1.jpg")
    (tmp_path / "a" / "loop").symlink_to(tmp_path)
    (tmp_path / "b").symlink_to(tmp_path / "a")
    (tmp_path / "self").symlink_to(tmp_path / "self")
    (tmp_path / "broken.jpg").symlink_to(tmp_path / "gone.jpg")
    assert sorted(found(tmp_path, recursive=True)) == ["a/1.jpg", "broken.jpg"]
    assert "2 links to a folder" in find_photos([str(tmp_path)], recursive=True).describe_passed_over()


def test_patterns_that_a_shell_left_are_expanded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    touch(tmp_path / "a.jpg", tmp_path / "b.jpg", tmp_path / "c.png", tmp_path / "odd[1].jpg")
    assert found(tmp_path, tmp_path / "*.jpg") == ["a.jpg", "b.jpg", "odd[1].jpg"]
    assert found(tmp_path, tmp_path / "odd[1].jpg") == ["odd[1].jpg"]
    with pytest.raises(InputError, match=r"no file matches .*\*\.tif"):
        find_photos([str(tmp_path / "*.tif")])


def test_a_photo_that_is_named_twice_is_found_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    touch(tmp_path / "a.jpg")
    monkeypatch.chdir(tmp_path)
    assert len(find_photos(["a.jpg", "./a.jpg", str(tmp_path), "*.jpg"]).photos) == 1


def test_long_and_deep_paths(tmp_path: Path) -> None:
    folder = tmp_path
    for _ in range(15):
        folder = folder / ("d" * 200)
    folder.mkdir(parents=True)
    (folder / "leaf.jpg").write_bytes(b"x")
    assert len(find_photos([str(tmp_path)], recursive=True).photos) == 1
    too_long = "x" * 5000 + ".jpg"
    assert [photo.path.name for photo in find_photos([too_long]).photos] == [too_long]


def test_folders_without_permission_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    touch(tmp_path / "a.jpg", tmp_path / "closed" / "b.jpg")
    scan = os.scandir

    def refuse(path: os.PathLike[str]) -> object:
        if Path(path).name == "closed":
            raise PermissionError(13, "Permission denied")
        return scan(path)

    monkeypatch.setattr(os, "scandir", refuse)
    text = find_photos([str(tmp_path)], recursive=True).describe_passed_over()
    assert "1 folder that cannot be listed" in text and "closed (Permission denied)" in text
    with pytest.raises(InputError, match=r"cannot list .*closed: Permission denied; check its permissions"):
        find_photos([str(tmp_path / "closed")])


def test_a_folder_without_photos_says_what_is_in_it(tmp_path: Path) -> None:
    touch(tmp_path / "sub" / "a.jpg", tmp_path / "b.doc")
    with pytest.raises(InputError, match=r"has no photo in it \(passed over: 1 file .*1 \.doc.*--recursive"):
        find_photos([str(tmp_path)])


@given(
    st.lists(
        st.text(st.characters(exclude_characters="/\0", exclude_categories=["Cs"]), min_size=1), unique=True
    )
)
def test_names_of_overlays_are_unique_short_and_do_not_depend_on_the_others(stems: list[str]) -> None:
    owners: dict[str, str] = {}
    given_names = {}
    for stem in stems:
        photo = FoundPhoto(Path(f"/photos/{'x' * 50}{stem}.jpg"))
        key = str(photo.path)
        name = _name_overlay(photo, PhotoPage(photo.path), key, owners, ())
        assert owners.setdefault(name.lower(), key) == key and len(name.encode()) <= 255
        assert name == _name_overlay(photo, PhotoPage(photo.path), key, {}, ())
        given_names[stem] = name
    assert len({name.lower() for name in given_names.values()}) == len(stems)
