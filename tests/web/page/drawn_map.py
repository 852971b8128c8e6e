"""What is to be seen on the map: pixels of one colour, and where the room is among them."""

from __future__ import annotations

from typing import NamedTuple

from tests.web.page.served_robot import MAP_M

_FIND = """name => {
  const style = getComputedStyle(document.documentElement);
  const wanted = style.getPropertyValue(`--map-${name}`).trim();
  const canvas = document.querySelector(".map canvas");
  const { width, height } = canvas;
  const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
  const colour = Number.parseInt(wanted.slice(1, 7), 16);
  let [count, sumX, sumY, left, top, right, bottom] = [0, 0, 0, width, height, -1, -1];
  for (let i = 0; i < data.length; i += 4) {
    if (((data[i] << 16) | (data[i + 1] << 8) | data[i + 2]) !== colour) continue;
    const [x, y] = [(i / 4) % width, Math.floor(i / 4 / width)];
    count++;
    sumX += x;
    sumY += y;
    [left, right] = [Math.min(left, x), Math.max(right, x)];
    [top, bottom] = [Math.min(top, y), Math.max(bottom, y)];
  }
  const box = canvas.getBoundingClientRect();
  const ratio = width / box.width;
  return [count, box.x + sumX / count / ratio, box.y + sumY / count / ratio,
          box.x + left / ratio, box.y + top / ratio,
          box.x + (right + 1) / ratio, box.y + (bottom + 1) / ratio];
}"""


class Pixels(NamedTuple):
    """Pixels of one colour: how many, their middle and their bounds on the page [px]."""

    count: int
    x: float
    y: float
    left: float
    top: float
    right: float
    bottom: float


def pixels(page, layer: str) -> Pixels:
    """Return the pixels that have the colour of a layer."""
    return Pixels(*page.evaluate(_FIND, layer))


def on_page(page, x_m: float, y_m: float) -> tuple[float, float]:
    """Return where on the page a point of the room is, by its drawn walls."""
    walls = pixels(page, "wall")
    return (
        walls.left + (walls.right - walls.left) * x_m / MAP_M[0],
        walls.bottom - (walls.bottom - walls.top) * y_m / MAP_M[1],
    )


def show_only(page, *layers: str) -> None:
    """Switch all layers off but these, by their names on the page."""
    page.locator(".map-layers summary").click()
    for button in page.locator("button.layer").all():
        if (button.inner_text() in layers) != (button.get_attribute("aria-pressed") == "true"):
            button.click()
    page.locator(".map-layers summary").click()
