// Elements, and messages to the person.

export const $ = (id) => document.getElementById(id);

/** Return a new element with properties, attributes (names with a dash or `role`), listeners (on...) and children. */
export function el(name, given = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(given)) {
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (key.includes("-") || key === "role" || key === "for" || key === "list") element.setAttribute(key, value);
    else element[key] = value;
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

/** Show a sentence until it is closed or taken away by `unsay`; one of the same `key` takes its place. */
export function say(sentence, { key = sentence, info = false, seconds = 0 } = {}) {
  const place = $("messages");
  const same = [...place.children].find((child) => child.dataset.key === key);
  const close = el("button", { type: "button", "aria-label": "Close", textContent: "×" });
  const box = el("div", { className: info ? "message info" : "message" }, el("p", { textContent: sentence }), close);
  box.dataset.key = key;
  close.addEventListener("click", () => box.remove());
  if (same) same.replaceWith(box);
  else place.append(box);
  if (seconds) setTimeout(() => box.remove(), seconds * 1000);
}

/** Take the sentence of a `key` away. */
export function unsay(key) {
  for (const box of [...$("messages").children]) if (box.dataset.key === key) box.remove();
}

/** Return a duration in words. */
export function duration(seconds) {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return "–";
  const whole = Math.round(seconds);
  if (whole < 90) return `${whole} s`;
  const minutes = Math.round(whole / 60);
  return minutes < 90 ? `${minutes} min` : `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

/** Fill a select with options [value, label], or groups {label, options}; keeps the choice where it is still there. */
export function fillSelect(select, entries) {
  const before = select.value;
  const option = ([value, label]) => el("option", { value, textContent: label });
  select.replaceChildren(
    ...entries.map((entry) => (Array.isArray(entry) ? option(entry) : el("optgroup", { label: entry.label }, ...entry.options.map(option)))),
  );
  if ([...select.options].some((one) => one.value === before)) select.value = before;
}
