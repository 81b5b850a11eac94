/* Parts that every compiled module has: its work, compiled for every instruction set; look-up and list of these sets; and
 * its slots. Include after WORK, a list of X(function, work, type, name, attributes): the `function` of a Level does `work`
 * on a `type`. */
#define POINTER(function, work, type, name, attributes) void (*function)(const type *given);
typedef struct {
    const char *name;
    WORK(POINTER, , )
    int (*supported)(void);
} Level;

#define COMPILED(function, work, type, name, attributes) \
    attributes static void function##_##name(const type *given) { work(given); }
#define COMPILED_FOR(name, attributes, supported) WORK(COMPILED, name, attributes)
#define PLACED(function, work, type, name, attributes) function##_##name,
#define LISTED(name, attributes, supported) {#name, WORK(PLACED, name, ) supported},
FOR_EACH_LEVEL(COMPILED_FOR)
static const Level LEVELS[] = {FOR_EACH_LEVEL(LISTED)};
#define LEVEL_COUNT (sizeof LEVELS / sizeof *LEVELS)

/* Return the level with this name if this processor has it; otherwise set an error and return NULL. */
static const Level *find_level(const char *name) {
    for (size_t i = 0; i < LEVEL_COUNT; i++)
        if (!strcmp(LEVELS[i].name, name) && LEVELS[i].supported()) return &LEVELS[i];
    PyErr_Format(PyExc_ValueError, "found level %s, expected one that levels() lists", name);
    return NULL;
}

/* Append a name to a list. If that fails, set an error, and drop the list: it becomes NULL. */
static void append_name(PyObject **names, const char *text) {
    PyObject *name = PyUnicode_FromString(text);
    if (!name || PyList_Append(*names, name) < 0) Py_CLEAR(*names);
    Py_XDECREF(name);
}

static PyObject *levels(PyObject *module, PyObject *none) {
    (void)module, (void)none;
    PyObject *names = PyList_New(0);
    for (size_t i = 0; names && i < LEVEL_COUNT; i++)
        if (LEVELS[i].supported()) append_name(&names, LEVELS[i].name);
    return names;
}
#define LEVELS_METHOD {"levels", levels, METH_NOARGS, "Names of the instruction sets that this processor has, the fastest first."}

static PyModuleDef_Slot SLOTS[] = {
#ifdef Py_MOD_GIL_NOT_USED
    {Py_mod_gil, Py_MOD_GIL_NOT_USED},
#endif
    {0, NULL}};
