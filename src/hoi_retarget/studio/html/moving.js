"use strict";
// Pictures of links move while they are pointed at or touched; their films are not loaded before.
(() => {
  if (matchMedia("(prefers-reduced-motion: reduce)").matches) return;
  let moving = null;
  const move = ({ target }) => {
    const picture = target.closest?.("a")?.querySelector("img[data-film]") ?? null;
    if (picture === moving) return;
    if (moving) moving.src = moving.dataset.still;
    moving = picture;
    if (!picture) return;
    picture.dataset.still ??= picture.getAttribute("src");
    picture.src = picture.dataset.film;
  };
  document.addEventListener("pointerover", move);
  document.addEventListener("focusin", move);
})();
