const form = document.querySelector("form");
form.addEventListener("change", () => form.submit());
document.addEventListener("keydown", (event) => {
  const rel = { ArrowLeft: "prev", ArrowRight: "next" }[event.key];
  if (rel && event.target.tagName !== "SELECT") document.querySelector(`a[rel=${rel}]`)?.click();
});
