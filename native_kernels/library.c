/* Kernels without numba: machine code of many versions, each chosen by the types of the arguments.
 *
 * Included at the end of what `build.py` writes, behind numba's own
 * `modulemixin.c` and the tables `environments`, `versions` and `table`.
 */

#include <structmember.h>

#define ROOM 1000 /* bytes of a fingerprint */
#define OTHER (-1) /* a type without a version here */
#define FAILED (-2) /* an exception is set */

typedef struct {
    PyObject_HEAD
    PyObject *function, *dispatcher, *dict;
    Py_ssize_t count;
    struct { PyObject *fingerprint; int version; } *known;
} Kernel;

/* Returns the numba dispatcher of a function; the number of a named tuple's class, -1 if unknown. */
static PyObject *dispatcher_of, *number_of;
static PyObject *record_types; /* list of dtype, of equal ones the last that came */
static PyObject **environment_objects;
static struct { PyTypeObject *type; long number; } *classes;
static int class_count;

/* Numba's function of this name, as machine code calls it, but each object is made only once. */
#undef numba_unpickle
PyObject *
numba_unpickle(const char *data, int size, const char *digest)
{
    static struct { const char *data; PyObject *object; } made[1 << 12];
    size_t at = ((size_t)data >> 4) % (sizeof made / sizeof *made), end = at + 16;
    for (; digest && at < end && at < sizeof made / sizeof *made; at++) {
        if (made[at].data == data)
            return Py_NewRef(made[at].object);
        if (!made[at].data) {
            PyObject *object = unpickled(data, size, digest);
            if (object) {
                made[at].data = data; /* a constant of the library */
                made[at].object = Py_NewRef(object);
            }
            return object;
        }
    }
    return unpickled(data, size, digest);
}

static long
number_of_class(PyTypeObject *type)
{
    for (int i = 0; i < class_count; i++)
        if (classes[i].type == type)
            return classes[i].number;
    PyObject *found = PyObject_CallOneArg(number_of, (PyObject *)type);
    if (!found)
        return FAILED;
    long number = PyLong_AsLong(found);
    Py_DECREF(found);
    void *more = PyMem_Realloc(classes, (class_count + 1) * sizeof *classes);
    if (!more) {
        PyErr_NoMemory();
        return FAILED;
    }
    classes = more;
    Py_INCREF(type); /* its address stands for it */
    classes[class_count].type = type;
    classes[class_count++].number = number;
    return number;
}

static int
number_of_record(PyArray_Descr *type)
{
    Py_ssize_t count = PyList_GET_SIZE(record_types);
    for (Py_ssize_t i = 0; i < count; i++)
        if (PyList_GET_ITEM(record_types, i) == (PyObject *)type)
            return (int)i;
    for (Py_ssize_t i = 0; i < count; i++) { /* field by field: microseconds */
        PyArray_Descr *known = (PyArray_Descr *)PyList_GET_ITEM(record_types, i);
        if (PyArray_EquivTypes(known, type)
            && PyDataType_FLAGCHK(known, NPY_ALIGNED_STRUCT)
                   == PyDataType_FLAGCHK(type, NPY_ALIGNED_STRUCT)) {
            PyList_SetItem(record_types, i, Py_NewRef(type));
            return (int)i;
        }
    }
    return OTHER;
}

static int
fingerprint_of_array(PyArrayObject *array, char *out, int at)
{
    int flags = PyArray_FLAGS(array), number = PyArray_TYPE(array), record = 0;
    if (!(flags & NPY_ARRAY_ALIGNED) || PyArray_ISBYTESWAPPED(array))
        return OTHER;
    if (number == NPY_VOID && (record = number_of_record(PyArray_DESCR(array))) < 0)
        return OTHER;
    if (number > NPY_VOID)
        return OTHER;
    out[at++] = 'A';
    out[at++] = (char)('!' + number);
    out[at++] = (char)('!' + record);
    out[at++] = (char)('!' + PyArray_NDIM(array));
    out[at++] = flags & NPY_ARRAY_C_CONTIGUOUS ? 'C' : flags & NPY_ARRAY_F_CONTIGUOUS ? 'F' : 'A';
    out[at++] = flags & NPY_ARRAY_WRITEABLE ? 'w' : 'r';
    return at;
}

/* Writes the fingerprint of an argument's type; returns where it ends. As `fingerprint` does. */
static int
fingerprint(PyObject *value, char *out, int at)
{
    PyTypeObject *type = Py_TYPE(value);
    if (at > ROOM - 8)
        return OTHER;
    if (type == &PyArray_Type)
        return fingerprint_of_array((PyArrayObject *)value, out, at);
    if (PyTuple_Check(value)) {
        Py_ssize_t size = PyTuple_GET_SIZE(value);
        if (size > 90)
            return OTHER;
        if (type == &PyTuple_Type) {
            out[at++] = 'T';
        } else {
            long number = number_of_class(type);
            if (number < 0)
                return (int)number;
            out[at++] = 'N';
            out[at++] = (char)('!' + number);
        }
        out[at++] = (char)('!' + size);
        for (Py_ssize_t i = 0; i < size && at >= 0; i++)
            at = fingerprint(PyTuple_GET_ITEM(value, i), out, at);
        return at;
    }
    if (type == &PyLong_Type) {
        int overflow;
        PyLong_AsLongAndOverflow(value, &overflow);
        if (overflow)
            return OTHER;
        out[at++] = 'l';
    } else if (type == &PyFloat_Type || PyArray_IsScalar(value, Double)) {
        out[at++] = 'd';
    } else if (type == &PyBool_Type || PyArray_IsScalar(value, Bool)) {
        out[at++] = 'b';
    } else if (PyArray_IsScalar(value, Long)) {
        out[at++] = 'l';
    } else if (PyArray_IsScalar(value, Float)) {
        out[at++] = 'f';
    } else if (Py_IsNone(value)) {
        out[at++] = 'n';
    } else if (strcmp(type->tp_name, "numpy.random._generator.Generator") == 0) {
        out[at++] = 'G';
    } else {
        return OTHER;
    }
    return at;
}

static PyObject *
dispatcher(Kernel *self, void *Py_UNUSED(closure))
{
    if (!self->dispatcher)
        self->dispatcher = PyObject_CallOneArg(dispatcher_of, self->function);
    return Py_XNewRef(self->dispatcher);
}

static PyObject *
call(Kernel *self, PyObject *arguments, PyObject *named)
{
    char bytes[ROOM];
    int end = named && PyDict_GET_SIZE(named) ? OTHER : 0;
    for (Py_ssize_t i = 0; i < PyTuple_GET_SIZE(arguments) && end >= 0; i++)
        end = fingerprint(PyTuple_GET_ITEM(arguments, i), bytes, end);
    if (end == FAILED)
        return NULL;
    for (Py_ssize_t k = 0; k < self->count && end >= 0; k++) {
        PyObject *known = self->known[k].fingerprint;
        if (PyBytes_GET_SIZE(known) == end && !memcmp(PyBytes_AS_STRING(known), bytes, end)) {
            int version = self->known[k].version;
            return versions[version].wrapper(
                environment_objects[versions[version].environment], arguments, NULL);
        }
    }
    PyObject *other = dispatcher(self, NULL);
    PyObject *result = other ? PyObject_Call(other, arguments, named) : NULL;
    Py_XDECREF(other);
    return result;
}

static PyObject *
new_kernel(PyTypeObject *type, PyObject *arguments, PyObject *Py_UNUSED(named))
{
    PyObject *function, *known;
    if (!PyArg_ParseTuple(arguments, "OO!", &function, &PyList_Type, &known))
        return NULL;
    Kernel *self = (Kernel *)type->tp_alloc(type, 0);
    if (!self)
        return NULL;
    self->function = Py_NewRef(function);
    self->known = PyMem_Calloc(PyList_GET_SIZE(known) + 1, sizeof *self->known);
    for (Py_ssize_t k = 0; self->known && k < PyList_GET_SIZE(known); k++) {
        const char *bytes;
        Py_ssize_t size;
        if (!PyArg_ParseTuple(
                PyList_GET_ITEM(known, k), "s#i", &bytes, &size, &self->known[k].version))
            return NULL;
        self->known[k].fingerprint = PyBytes_FromStringAndSize(bytes, size);
        self->count++;
    }
    return (PyObject *)self;
}

static PyObject *
reduce(Kernel *self, PyObject *Py_UNUSED(nothing))
{
    return PyObject_GetAttrString(self->function, "__qualname__");
}

/* What numba's dispatchers have besides: asked of the dispatcher. */
static PyObject *
attribute(PyObject *self, PyObject *name)
{
    PyObject *found = PyObject_GenericGetAttr(self, name);
    const char *text = PyUnicode_AsUTF8(name);
    if (found || !text || text[0] == '_' || !PyErr_ExceptionMatches(PyExc_AttributeError))
        return found;
    PyErr_Clear();
    PyObject *other = dispatcher((Kernel *)self, NULL);
    found = other ? PyObject_GetAttr(other, name) : NULL;
    Py_XDECREF(other);
    return found;
}

static PyMethodDef kernel_methods[] = {
    {"__reduce__", (PyCFunction)reduce, METH_NOARGS, "Name of the function: kept by reference."},
    {NULL},
};
static PyMemberDef kernel_members[] = {
    {"py_func", T_OBJECT, offsetof(Kernel, function), READONLY, "The function in Python."},
    {"__dictoffset__", T_PYSSIZET, offsetof(Kernel, dict), READONLY},
    {NULL},
};
static PyGetSetDef kernel_getset[] = {
    {"dispatcher", (getter)dispatcher, NULL, "Numba's dispatcher: it loads numba.", NULL},
    {"__dict__", PyObject_GenericGetDict, PyObject_GenericSetDict, NULL, NULL},
    {NULL},
};
static PyTypeObject kernel_type = {
    PyVarObject_HEAD_INIT(NULL, 0)
    .tp_name = "kernel_library.Kernel",
    .tp_basicsize = sizeof(Kernel),
    .tp_dictoffset = offsetof(Kernel, dict),
    .tp_flags = Py_TPFLAGS_DEFAULT,
    .tp_new = new_kernel,
    .tp_call = (ternaryfunc)call,
    .tp_getattro = attribute,
    .tp_methods = kernel_methods,
    .tp_members = kernel_members,
    .tp_getset = kernel_getset,
};

static PyObject *
set_up(PyObject *Py_UNUSED(module), PyObject *arguments)
{
    if (!PyArg_ParseTuple(
            arguments, "OOO!", &dispatcher_of, &number_of, &PyList_Type, &record_types))
        return NULL;
    Py_INCREF(dispatcher_of);
    Py_INCREF(number_of);
    Py_INCREF(record_types);
    Py_RETURN_NONE;
}

static PyMethodDef module_methods[] = {{"set_up", set_up, METH_VARARGS}, {NULL}};
static PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "kernel_library", NULL, -1, module_methods,
};

PyMODINIT_FUNC
PyInit_kernel_library(void)
{
    static PyMethodDef none[] = {{NULL}};
    env_gv_t nothing[] = {NULL};
    PyObject *module = PyModule_Create(&definition);
    if (!module || pycc_init_kernel_library(module, none, NULL, nothing)
        || PyType_Ready(&kernel_type))
        return NULL;
    size_t count = sizeof environments / sizeof *environments;
    environment_objects = PyMem_Calloc(count, sizeof *environment_objects);
    for (size_t i = 0; i < count; i++) {
        env_def_t constants = {environments[i].data, environments[i].size, NULL, NULL, 0};
        PyObject *made = (PyObject *)recreate_environment(module, constants);
        if (!made)
            return NULL;
        *environments[i].place = environment_objects[i] = made;
    }
    if (PyModule_AddStringConstant(module, "table", table)
        || PyModule_AddObjectRef(module, "Kernel", (PyObject *)&kernel_type))
        return NULL;
    return module;
}
