"""A version is tagged when nothing is in the way, and each thing in the way is a sentence."""

import subprocess

import pytest

import release


@pytest.fixture
def project(tmp_path):
    """A repository whose version can be released."""
    (tmp_path / "pyproject.toml").write_text('[project]\nversion = "1.2.0"\n')
    (tmp_path / "CHANGELOG.md").write_text(
        "# Changelog\n\n## 1.2.0 (2026-05-01)\n\n- New.\n\n## 1.1.0 (2026-01-01)\n"
    )
    for words in (["init", "-q"], ["add", "."], ["commit", "-qm", "a"], ["tag", "v1.1.9"], ["tag", "vnext"]):
        git(tmp_path, *words)
    return tmp_path


def git(folder, *words) -> str:
    person = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
    return subprocess.run(
        ["git", *person, *words], cwd=folder, check=True, capture_output=True, text=True
    ).stdout


def commit(folder, name: str, text: str) -> None:
    (folder / name).write_text(text)
    git(folder, "commit", "-qam", "b")


def test_a_release_is_tagged_with_its_changes(project, monkeypatch):
    for key in ("AUTHOR", "COMMITTER"):
        monkeypatch.setenv(f"GIT_{key}_NAME", "a")
        monkeypatch.setenv(f"GIT_{key}_EMAIL", "a@example.org")
    assert list(release.obstacles(project)) == []
    assert release.tag(project) == "v1.2.0"
    assert git(project, "tag", "-n9", "-l", "v1.2.0").split() == [
        "v1.2.0",
        "lightprobe",
        "1.2.0",
        "-",
        "New.",
    ]
    assert "1.2.0 is not higher than 1.2.0" in " ".join(release.obstacles(project))


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("pyproject.toml", '[project]\nversion = "1.2.0.dev1"\n', "not X.Y.Z"),
        ("pyproject.toml", '[project]\nversion = "1.1.2"\n', "not higher than 1.1.9"),
        ("CHANGELOG.md", "## 1.2.0 (unreleased)\n\n- New.\n", "no date"),
        ("CHANGELOG.md", "## 1.2.0 (2026-05-01)\n\n## 1.1.0 (2026-01-01)\n\n- Old.\n", "what is new"),
        ("CHANGELOG.md", "## 1.1.0 (2026-01-01)\n\n- Old.\n", "does not begin with"),
    ],
)
def test_what_is_in_the_way_is_named(project, name, text, words):
    commit(project, name, text)
    assert words in " ".join(release.obstacles(project))


def test_changes_that_are_not_committed_are_in_the_way(project):
    (project / "new.txt").touch()
    assert "not committed: ?? new.txt" in " ".join(release.obstacles(project))
