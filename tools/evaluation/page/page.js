"use strict";
const all = (selector, root = document) => [...root.querySelectorAll(selector)];

// Tabs: one table of a set at a time. Without this script all are shown.
for (const tabs of all(".tabs")) {
  const buttons = all("button", tabs);
  const choose = (chosen) => buttons.forEach((button) => {
    const on = button === chosen;
    button.setAttribute("aria-selected", String(on));
    button.tabIndex = on ? 0 : -1;
    document.getElementById(button.getAttribute("aria-controls")).hidden = !on;
  });
  buttons.forEach((button, index) => {
    button.addEventListener("click", () => choose(button));
    button.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!step) return;
      const next = buttons[(index + step + buttons.length) % buttons.length];
      choose(next);
      next.focus();
    });
  });
  tabs.hidden = false;
  choose(buttons[0]);
}

// Legends switch the lines of the plots they belong to.
for (const legend of all(".legend")) {
  legend.hidden = false;
  legend.addEventListener("change", (event) => {
    for (const line of all("[data-series]", legend.parentElement)) {
      if (line.dataset.series === event.target.value) line.classList.toggle("off", !event.target.checked);
    }
  });
}

// Exhibits: two pictures under a slider, chosen from the strip below.
for (const exhibit of all(".exhibit")) {
  const pictures = all(".strip img", exhibit);
  const [left, right] = all("select", exhibit);
  const [first, second] = all(".viewer img", exhibit);
  const viewer = exhibit.querySelector(".viewer");
  const output = exhibit.querySelector("output");
  const show = (image, index) => { image.src = pictures[index].src; image.alt = pictures[index].alt; };
  const update = () => {
    show(first, left.value);
    show(second, right.value);
    for (const select of [left, right]) select.title = select.selectedOptions[0].text; // a long name may not fit
  };
  const zoomTo = (zoom) => {
    viewer.style.setProperty("--zoom", zoom);
    output.textContent = `${zoom}×`;
    exhibit.dataset.zoom = zoom;
  };
  left.addEventListener("change", update);
  right.addEventListener("change", update);
  all(".strip button", exhibit).forEach((button, index) => button.addEventListener("click", () => { right.value = String(index); update(); }));
  all(".zoom button", exhibit).forEach((button) => button.addEventListener("click", () => {
    zoomTo(Math.min(12, Math.max(1, Number(exhibit.dataset.zoom) + Number(button.value))));
  }));
  update();
  for (const hidden of all("[data-script]", exhibit)) hidden.hidden = false;
  zoomTo(Math.max(1, Math.min(5, Math.floor((exhibit.clientWidth - 32) / Number(viewer.dataset.pixels)))));
}
