"""What every refusal of a server must be."""


def sentence(response, status):
    """Return the sentence of a refusal, after a look at its form."""
    assert response.status_code == status, response.text
    text = response.json()["sentence"]
    assert text.endswith(".")
    assert "Traceback" not in text
    assert "/request-" not in text
    return text
